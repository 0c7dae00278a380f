"""The results of `speed.py` on one cloud, which its tables and its plot show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from clouds import Cloud


@dataclass(frozen=True)
class Run:
    """The fastest of several runs, and the memory of the first.

    Attributes
    ----------
    seconds : float
        In total.
    timer : mapping of name to float
        Seconds of each stage.
    memory : float
        Peak memory above the input, in bytes for each point.
    """

    seconds: float
    timer: Mapping[str, float]
    memory: float


@dataclass(frozen=True)
class Measured:
    """The results on one cloud.

    Attributes
    ----------
    cloud : Cloud
        The cloud.
    runs : mapping of method to Run
        Methods that were left out are missing.
    single : Run, optional
        That of gp with one thread.
    writing, reading : float
        Seconds for a PLY file.
    """

    cloud: Cloud
    runs: Mapping[str, Run]
    single: Run | None
    writing: float
    reading: float

    @property
    def names(self) -> tuple[str, str, str]:
        """The first cells of its rows: name, points, points kept."""
        return self.cloud.name, f"{self.cloud.size:,}", f"{self.cloud.n_points:,}"
