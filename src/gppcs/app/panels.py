"""The titles of the groups in which the help of a command lists its options. Those in no group come first."""

from __future__ import annotations

from typing import Final

SIZE: Final = "Size of the result"
CHOICE: Final = "Choice of the points"
METHOD: Final = "Method"
INPUT: Final = "Reading the input"
ATTRIBUTES: Final = "Attributes of the result"
LOOK: Final = "Figures and pictures"
LARGE: Final = "Files larger than memory"
