"""Points of files with what the choice needs of each, and what it finds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.constraints import Constraints
from gppcs.amounts.options import Options
from gppcs.clouds.cloud import PointCloud
from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.methods.method import SCORES
from gppcs.streaming.scratch import read_arrays, write_arrays

ATTRIBUTE = "attribute "  # begins the names of columns that are attributes of the cloud


@dataclass(frozen=True, eq=False)
class Rows:
    """Some points of a cloud.

    Of points that may be kept, the columns are "keep", "weight" and "label", (n,), as far as the options ask for them
    (see `Constraints`), the attributes that the method reads, and "box", (n,), if a source gives them. Of those that
    are kept, they are "label", "rank", (n,), "normals", (n, 3), if they are asked for, and what the method tells of
    some: new positions, "moved", (n, 3), and scores, (n,).
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
            columns["weight"] = constraints.weights
        if constraints.labels is not None:
            columns["label"] = constraints.labels
        rows = cls(first + finite, cloud.points if len(finite) == len(cloud) else cloud.points[finite], columns)
        usable = constraints.usable(len(finite))
        return rows if len(usable) == len(finite) else rows.take(usable)

    @classmethod
    def joined(cls, parts: Iterable[Rows]) -> Rows:
        """Return the rows of at least one part as one; of columns that a part lacks, its rows have 0."""
        listed = list(parts)
        columns = {name: values for part in listed for name, values in part.columns.items()}
        return cls(
            np.concatenate([part.indices for part in listed]),
            np.concatenate([part.points for part in listed]),
            {
                name: np.concatenate([part.column(name, values.dtype, values.shape[1:]) for part in listed])
                for name, values in columns.items()
            },
        )

    def column(self, name: str, kind: Any = np.float64, shape: tuple[int, ...] = ()) -> NDArray[Any]:
        """Return a column, (n, *shape); where points are, if none is moved, and otherwise 0 if it is missing."""
        if name not in self.columns and name == "moved":
            return self.points
        return self.columns.get(name, np.zeros((len(self), *shape), kind))

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read rows that a task has written."""
        columns = read_arrays(path)
        return cls(columns.pop("indices"), columns.pop("points"), columns)

    def write(self, path: Path) -> None:
        """Write a file."""
        write_arrays(path, {"indices": self.indices, "points": self.points, **self.columns})

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
        return self.column("keep", np.bool_)

    @property
    def boxes(self) -> NDArray[np.uint16]:
        """The box of the source in which each lies, (n,)."""
        return self.column("box", np.uint16)

    @property
    def labels(self) -> NDArray[np.uint8]:
        """The quota of each, (n,); 0 without quotas."""
        return self.column("label", np.uint8)

    @property
    def ranks(self) -> Floats:
        """About the place of each kept one in the order of all, (n,).

        It is negative for points that are kept anyway, and the number of all for spare ones.
        """
        return self.columns["rank"]

    @property
    def positions(self) -> Floats:
        """Where they are in the end, (n, 3)."""
        return self.column("moved")

    @property
    def scores(self) -> Mapping[str, Floats]:
        """The scores of the method, if it reports some."""
        return {name: self.columns[name] for name in SCORES if name in self.columns}

    @property
    def counts(self) -> Ints:
        """Number of kept points, and of those that are kept anyway, by quota, (2, 256)."""
        return np.array([np.bincount(labels, minlength=256) for labels in (self.labels, self.labels[self.ranks < 0.0])])

    @property
    def attributes(self) -> PointCloud:
        """The attributes that the method reads."""
        named = {name.removeprefix(ATTRIBUTE): values for name, values in self.columns.items() if ATTRIBUTE in name}
        return PointCloud(self.points, named)
