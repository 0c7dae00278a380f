"""The simplification methods by name. To add one, write its file or folder here and import its class below.

The class is a `Method`, see `methods/method.py`. Its name, parameters and help then appear everywhere: in
`gppcs.METHODS`, `gppcs.simplify`, `gppcs.compare` and the commands. Installed packages add methods by entry points of
the group `gppcs.methods`.
"""

from gppcs.methods.method import Feature as Feature
from gppcs.methods.method import Method as Method
from gppcs.methods.method import Selection as Selection
from gppcs.methods.method import Task as Task
from gppcs.methods.parameters import parameter as parameter
from gppcs.methods.registry import Registry

# One line for each method, in the order in which lists show them. "X as X" makes X public for type checkers.
# isort: off
from gppcs.methods.gp import LocalGP as LocalGP
from gppcs.methods.gp_spectral import SpectralGP as SpectralGP
from gppcs.methods.fps_variation import FarthestPointVariation as FarthestPointVariation
from gppcs.methods.top_variation import TopVariation as TopVariation
from gppcs.methods.fps import FarthestPoint as FarthestPoint
from gppcs.methods.random import Random as Random
from gppcs.methods.hc import HierarchicalClustering as HierarchicalClustering
from gppcs.methods.wlop import WLOP as WLOP
from gppcs.methods.sample_elimination import SampleElimination as SampleElimination
from gppcs.methods.voxel import Voxel as Voxel
from gppcs.methods.aivs import AIVS as AIVS
from gppcs.methods.pc_simp import PCSimp as PCSimp
from gppcs.methods.qem import QEM as QEM
# isort: on

# All methods by name, such as METHODS["fps"].
METHODS = Registry(
    {
        value.name: value
        for value in list(globals().values())
        if isinstance(value, type) and issubclass(value, Method) and value is not Method
    },
    aliases={"gp-pcs-released": "fps-variation"},
)
DEFAULT = LocalGP()
