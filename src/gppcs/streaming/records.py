"""What the records of points on disk hold beside rows and places: weights, and attributes that the choice needs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.guide import WeightRange
from gppcs.amounts.request import Request
from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.ranges import Details
from gppcs.spatial.stored import RECORD

MARK = "="  # begins the fields of attributes as they come


def raw_field(name: str) -> str:
    """Return the field of the records for an attribute, apart from those that are always there."""
    return f"{MARK}{name}"


def raw_kind(weighted: bool, names: Iterable[str]) -> np.dtype[Any]:
    """Return the type of the records of points as they come, with attributes that the choice needs."""
    more: list[Any] = [("weight", np.float64)] if weighted else []
    return np.dtype([*RECORD.descr, *more, *((raw_field(name), np.float64) for name in names)])


@dataclass(frozen=True)
class Columns:
    """What the records hold beside rows and places, once they are sorted."""

    raw: np.dtype[Any]  # of the points as they came
    weights: WeightRange | None
    details: Details | None  # what becomes the field "detail", (k,)
    values_of: str | None  # the attribute that becomes the field "value"

    @classmethod
    def of(cls, sample: PointCloud, weights: WeightRange, request: Request) -> Columns:
        """Return what is asked for; the ranges of attributes are those of the sample."""
        details = Details.of(sample, request.detail) if request.detail else None
        raw = raw_kind(weights.n > 0, sample.attributes)
        return cls(raw, weights if weights.n else None, details, request.method.reads_attribute)

    @property
    def kind(self) -> np.dtype[Any]:
        """The type of the sorted records."""
        more: list[Any] = [] if self.weights is None else [("weight", np.float64)]
        if self.details and self.details.width:
            more.append(("detail", np.float32, (self.details.width,)))
        if self.values_of is not None:
            more.append(("value", np.float64))
        return np.dtype([*RECORD.descr, *more])

    def fill(self, records: NDArray[Any], raw: NDArray[Any]) -> None:
        """Fill records of the sorted kind, given those that came."""
        records["row"], records["place"] = raw["row"], raw["place"]
        if self.weights is not None:  # points of weight 0 are here only to be kept
            shares = self.weights.in_shares(np.ascontiguousarray(raw["weight"]))
            records["weight"] = np.where(shares > 0.0, shares, 1.0)
        if self.details and self.details.width:
            fields = [field for field in raw.dtype.names or () if field.startswith(MARK)]
            attributes = {field.removeprefix(MARK): raw[field] for field in fields}
            records["detail"] = self.details.values(PointCloud(raw["place"], attributes))
        if self.values_of is not None:
            records["value"] = raw[raw_field(self.values_of)]
