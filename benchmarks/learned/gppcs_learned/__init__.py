"""Learned methods of simplification for gppcs, with weights of our own: `apes`, `apes-global` and `potamias`."""

from gppcs_learned.apes import APES as APES
from gppcs_learned.apes import APESGlobal as APESGlobal
from gppcs_learned.potamias import Potamias as Potamias
