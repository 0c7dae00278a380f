"""Points of files with what the choice needs of each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.constraints import Constraints, WeightRange
from gppcs.amounts.options import Options
from gppcs.clouds.cloud import PointCloud
from gppcs.engine.arrays import Flags, Floats, Ints

ATTRIBUTE = "attribute "  # begins the names of columns that are attributes of the cloud


@dataclass(frozen=True, eq=False)
class Rows:
    """Some points of a cloud that may be kept.

    The columns are "keep", "weight" and "label", (n,), as far as the options ask for them (see `Constraints`), and the
    attributes that the method reads.
    """

    indices: Ints  # (n,), in the cloud
    points: Floats  # (n, 3)
    columns: Mapping[str, NDArray[Any]]

    @classmethod
    def from_cloud(cls, cloud: PointCloud, first: int, options: Options) -> Rows:
        """Return the points of a chunk of a cloud, the first of which has this index."""
        finite = np.flatnonzero(cloud.is_finite())
        constraints = Constraints.from_cloud(cloud, finite, options)
        columns: dict[str, NDArray[Any]] = {ATTRIBUTE + name: values for name, values in constraints.columns.items()}
        if options.keep is not None:
            columns["keep"] = np.zeros(len(finite), dtype=np.bool_)
            columns["keep"][constraints.keep] = True
        if constraints.weights is not None:
            WeightRange.from_weights(constraints.weights)  # which checks them
            columns["weight"] = constraints.weights
        if constraints.labels is not None:
            columns["label"] = constraints.labels
        rows = cls(first + finite, cloud.points if len(finite) == len(cloud) else cloud.points[finite], columns)
        usable = constraints.usable(len(finite))
        return rows if len(usable) == len(finite) else rows.take(usable)

    @classmethod
    def joined(cls, parts: Iterable[Rows]) -> Rows:
        """Return the rows of at least one part as one."""
        listed = list(parts)
        names = listed[0].columns
        return cls(
            np.concatenate([part.indices for part in listed]),
            np.concatenate([part.points for part in listed]),
            {name: np.concatenate([part.columns[name] for part in listed]) for name in names},
        )

    def __len__(self) -> int:
        return len(self.indices)

    def take(self, positions: Ints) -> Rows:
        """Return some rows."""
        columns = {name: values.take(positions, axis=0) for name, values in self.columns.items()}
        return Rows(self.indices.take(positions), self.points.take(positions, axis=0), columns)

    def only(self, mask: Flags) -> Rows:
        """Return the rows in a mask, (n,)."""
        return self if mask.all() else self.take(np.flatnonzero(mask))

    @property
    def keep(self) -> Flags:
        """Which of them are kept whatever happens, (n,)."""
        return self.columns.get("keep", np.zeros(len(self), dtype=np.bool_))

    @property
    def labels(self) -> NDArray[np.uint8]:
        """The quota of each, (n,); 0 without quotas."""
        return self.columns.get("label", np.zeros(len(self), dtype=np.uint8))

    @property
    def attributes(self) -> PointCloud:
        """The attributes that the method reads."""
        named = {name.removeprefix(ATTRIBUTE): values for name, values in self.columns.items() if ATTRIBUTE in name}
        return PointCloud(self.points, named)
