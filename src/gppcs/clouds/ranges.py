"""Attributes in units of their whole range: what counts as detail, and how far attributes differ."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.colours import full_scale, oklab
from gppcs.clouds.lookup import as_floats, bounded, check_named
from gppcs.clouds.objects import COLOUR
from gppcs.errors import InputError, ParameterError, number, shown

COLOURS = "rgb"  # stands for the attributes red, green and blue
CLASSES = ("classification", "label", "class")  # their numbers are names
HEAVIEST = 1000  # weight of an attribute; larger ones change little, and far larger ones overflow
MOST_CLASSES = 16  # of an attribute; the rarest of more are one class
RANGE = 0.02, 0.98  # shares of the points below the ends of a range, so that a few outliers do not make it
BEYOND = 0.5  # values farther than this beyond the ends of the range count as this far


def weights_of_detail(detail: Any) -> dict[str, float]:
    """Check the argument `detail` of `gppcs.simplify`: a name, or weights of names; those of weight 0 are left out."""
    if detail is None:
        return {}
    given = {detail: 1.0} if isinstance(detail, str) else detail
    expected = f"expected detail to be the name of an attribute, or a mapping of names to weights from 0 to {HEAVIEST}"
    if not isinstance(given, Mapping):
        raise ParameterError(f"{expected}, found {shown(detail)}")
    for name, weight in given.items():
        if not isinstance(name, str) or not 0.0 <= number(weight) <= HEAVIEST:
            raise ParameterError(f"{expected}, found {shown(name)} with {shown(weight)}")
    return {name: float(weight) for name, weight in given.items() if weight > 0}


def names_of_detail(detail: Any) -> list[str]:
    """Check the argument `detail` of `gppcs.evaluate`: the name of an attribute, or several."""
    names = [detail] if isinstance(detail, str) else detail
    if not (isinstance(names, list | tuple) and all(isinstance(name, str) for name in names)):
        raise ParameterError(
            f"expected detail to be the name of an attribute, or a list of names, found {shown(detail)}"
        )
    return list(names)


@dataclass(frozen=True)
class AttributeRange:
    """How values become numbers in which 1 is their range: OKLab for colours, points 1 apart for classes."""

    name: str
    # Of numbers: the low end and the length of the range, 0 if all are equal. Of colours, the span is their full scale.
    low: float = 0.0
    span: float = 0.0
    # The values that have a point of their own, the most frequent first, if they are classes.
    classes: tuple[Any, ...] = ()

    @classmethod
    def of(cls, cloud: PointCloud, name: str) -> AttributeRange:
        """Measure the range of an attribute of a cloud."""
        _check(cloud, name)
        if name == COLOURS:
            return cls(name, span=full_scale(np.stack([cloud.attributes[each] for each in COLOUR])))
        values = cloud.attributes[name]
        texts = values.dtype.kind in "US" or (values.dtype.kind == "O" and isinstance(values[0], str))
        if values.ndim > 1 or not (texts or values.dtype.kind in "biuf"):
            raise InputError(f"expected attribute {shown(name)} to hold one number or class for each point")
        if texts or values.dtype.kind == "b" or (name.lower() in CLASSES and values.dtype.kind in "iu"):
            return cls._of_classes(name, values, texts)
        return cls._of_numbers(name, as_floats(values))

    @classmethod
    def _of_classes(cls, name: str, values: NDArray[Any], texts: bool) -> AttributeRange:
        found, counts = np.unique(values, return_counts=True)
        if texts and len(found) > MOST_CLASSES:
            raise InputError(
                f"expected at most {MOST_CLASSES} different texts in attribute {shown(name)} to count as classes, "
                f"found {len(found):,}; name another attribute"
            )
        return cls(name, classes=tuple(found[np.argsort(-counts, kind="stable")][:MOST_CLASSES].tolist()))

    @classmethod
    def _of_numbers(cls, name: str, values: NDArray[np.float64]) -> AttributeRange:
        finite = values[np.isfinite(values)]
        if 2 * len(finite) < len(values):
            raise InputError(
                f"expected numbers in attribute {shown(name)}, found {len(values) - len(finite):,} of {len(values):,} "
                "that are NaN or infinite; name another attribute"
            )
        finite = bounded(finite)
        low, high = np.quantile(finite, RANGE)
        if not high > low:  # such as marks on few points
            low, high = finite.min(), finite.max()
        if high == low:
            warnings.warn(f"attribute {name!r} is {low:g} everywhere: it has no detail", stacklevel=2)
        return cls(name, float(low), float(high - low))

    @np.errstate(over="ignore")  # what becomes infinite is far beyond the range
    def values(self, cloud: PointCloud) -> NDArray[np.float32]:
        """Return the attribute of a cloud in ranges, (N, k); values that are not finite count as the middle."""
        _check(cloud, self.name)
        if self.name == COLOURS:
            colours = np.stack([cloud.attributes[each] for each in COLOUR], axis=1)
            return oklab(np.clip(np.nan_to_num(colours.astype(np.float32)) / np.float32(self.span), 0.0, 1.0))
        values = cloud.attributes[self.name]
        if self.classes:
            known = np.array(self.classes, dtype=values.dtype)
            return (values[:, np.newaxis] == known).astype(np.float32) / np.float32(math.sqrt(2.0))
        shares = (bounded(values) - self.low) / (self.span or 1.0)
        return np.clip(np.nan_to_num(shares, nan=0.5), -BEYOND, 1.0 + BEYOND).astype(np.float32)[:, np.newaxis]


@dataclass(frozen=True)
class Details:
    """The attributes that count as detail, with their ranges and weights."""

    known: tuple[tuple[AttributeRange, float], ...]  # Without attributes that are constant

    @classmethod
    def of(cls, cloud: PointCloud, detail: Mapping[str, float]) -> Details:
        """Measure the ranges of attributes, whose weights are given, of a cloud or a sample of it."""
        ranges = ((AttributeRange.of(cloud, name), weight) for name, weight in detail.items())
        return cls(tuple((known, weight) for known, weight in ranges if known.span or len(known.classes) > 1))

    @property
    def width(self) -> int:
        """Number k of the columns of `values`."""
        return sum(len(known.classes) or (3 if known.name == COLOURS else 1) for known, _ in self.known)

    def values(self, cloud: PointCloud) -> NDArray[np.float32] | None:
        """Return the attributes of a cloud in their ranges times their weights, (N, k); None if all are constant."""
        columns = [np.float32(weight) * known.values(cloud) for known, weight in self.known]
        return np.concatenate(columns, axis=1) if columns else None


def columns_of_detail(cloud: PointCloud, names: Iterable[str]) -> list[str]:
    """Return the attributes of a cloud that names of detail stand for; an error if there are none."""
    columns: list[str] = []
    for name in names:
        _check(cloud, name)
        columns += COLOUR if name == COLOURS else [name]
    return columns


def _check(cloud: PointCloud, name: str) -> None:
    """Raise an error if a cloud has no attribute of a name, or no colours."""
    colours = [COLOURS] if set(COLOUR) <= set(cloud.attributes) else []
    check_named(name, [*colours, *cloud.attributes], "to count as detail")
