"""Attributes in units of their whole range: what counts as detail, and how far attributes differ."""

import math
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.colours import full_scale, oklab
from gppcs.clouds.columns import COLOUR
from gppcs.clouds.lookup import as_floats, bounded, check_named
from gppcs.errors import InputError, ParameterError, number, shown

COLOURS = "rgb"  # stands for the attributes red, green and blue
CLASSES = ("classification", "label", "class")  # their numbers are names
MAX_WEIGHT = 1000  # of an attribute; larger ones change little, and far larger ones overflow
MAX_CLASSES = 16  # of an attribute; the rarest of more are one class


def weights_of_detail(detail: Any) -> dict[str, float]:
    """Check the argument `detail` of `gppcs.simplify`: a name, or weights of names; those of weight 0 are left out."""
    if detail is None:
        return {}
    weights = {detail: 1.0} if isinstance(detail, str) else detail
    expected = (
        f"expected `detail` to be the name of an attribute, or a mapping of names to weights from 0 to {MAX_WEIGHT}"
    )
    if not isinstance(weights, Mapping):
        raise ParameterError(f"{expected}, found {shown(detail)}")
    for name, weight in weights.items():
        if not isinstance(name, str) or not 0.0 <= number(weight) <= MAX_WEIGHT:
            raise ParameterError(f"{expected}, found {shown(name)} with {shown(weight)}")
    return {name: float(weight) for name, weight in weights.items() if weight > 0}


def names_of_detail(detail: Any) -> list[str]:
    """Check the argument `detail` of `gppcs.evaluate`: the name of an attribute, or several."""
    names = [detail] if isinstance(detail, str) else detail
    if not (isinstance(names, list | tuple) and all(isinstance(name, str) for name in names)):
        raise ParameterError(
            f"expected `detail` to be the name of an attribute, or a list of names, found {shown(detail)}"
        )
    return list(names)


@dataclass(frozen=True)
class AttributeRange:
    """How values become numbers in which 1 is their range: OKLab for colours, points 1 apart for classes."""

    name: str
    # Of numbers: the start and the length of the range, 0 if all are equal. Of colours, the span is their full scale.
    start: float = 0.0
    span: float = 0.0
    # The values that have a point of their own, the most frequent first, if they are classes.
    classes: tuple[Any, ...] = ()

    @classmethod
    def from_cloud(cls, cloud: PointCloud, name: str) -> Self:
        """Measure the range of an attribute of a cloud."""
        _check(cloud, name)
        if name == COLOURS:
            return cls(name, span=full_scale(np.stack([cloud.attributes[part] for part in COLOUR])))
        values = cloud.attributes[name]
        texts = values.dtype.kind in "US" or (values.dtype.kind == "O" and isinstance(values[0], str))
        if values.ndim > 1 or not (texts or values.dtype.kind in "biuf"):
            raise InputError(f"expected attribute {shown(name)} to hold one number or class for each point")
        if texts or values.dtype.kind == "b" or (name.lower() in CLASSES and values.dtype.kind in "iu"):
            return cls._of_classes(name, values, texts)
        return cls._of_numbers(name, as_floats(values))

    @classmethod
    def _of_classes(cls, name: str, values: NDArray[Any], texts: bool) -> Self:
        classes, counts = np.unique(values, return_counts=True)
        if texts and len(classes) > MAX_CLASSES:
            raise InputError(
                f"expected at most {MAX_CLASSES} different texts in attribute {shown(name)} to count as classes, "
                f"found {len(classes):,}; name another attribute"
            )
        return cls(name, classes=tuple(classes[np.argsort(-counts, kind="stable")][:MAX_CLASSES].tolist()))

    @classmethod
    def _of_numbers(cls, name: str, values: NDArray[np.float64]) -> Self:
        finite = values[np.isfinite(values)]
        if 2 * len(finite) < len(values):
            raise InputError(
                f"expected numbers in attribute {shown(name)}, found {len(values) - len(finite):,} of {len(values):,} "
                "that are NaN or infinite; name another attribute"
            )
        finite = bounded(finite)
        start, end = np.quantile(finite, (0.02, 0.98))  # so that a few outliers do not make the range
        if not end > start:  # such as marks on few points
            start, end = finite.min(), finite.max()
        if end == start:
            warnings.warn(f"attribute {name!r} is {start:g} everywhere: it has no detail", stacklevel=2)
        return cls(name, float(start), float(end - start))

    @np.errstate(over="ignore")  # what becomes infinite is far beyond the range
    def values(self, cloud: PointCloud) -> NDArray[np.float32]:
        """Return the attribute of a cloud in ranges, (N, k); values that are not finite count as the middle."""
        _check(cloud, self.name)
        if self.name == COLOURS:
            colours = np.stack([cloud.attributes[part] for part in COLOUR], axis=1)
            return oklab(np.clip(np.nan_to_num(colours.astype(np.float32)) / np.float32(self.span), 0.0, 1.0))
        values = cloud.attributes[self.name]
        if self.classes:
            classes = np.array(self.classes, dtype=values.dtype)
            return (values[:, np.newaxis] == classes).astype(np.float32) / np.float32(math.sqrt(2.0))
        fractions = np.nan_to_num((bounded(values) - self.start) / (self.span or 1.0), nan=0.5)
        return np.clip(fractions, -0.5, 1.5).astype(np.float32)[:, np.newaxis]  # outliers count as at most so far


@dataclass(frozen=True)
class Details:
    """The attributes that count as detail, with their ranges and weights."""

    weighted: tuple[tuple[AttributeRange, float], ...]  # Without attributes that are constant

    @classmethod
    def from_cloud(cls, cloud: PointCloud, detail: Mapping[str, float]) -> Self:
        """Measure the ranges of attributes, whose weights are given, of a cloud or a sample of it."""
        ranges = ((AttributeRange.from_cloud(cloud, name), weight) for name, weight in detail.items())
        return cls(tuple((item, weight) for item, weight in ranges if item.span or len(item.classes) > 1))

    def values(self, cloud: PointCloud) -> NDArray[np.float32] | None:
        """Return the attributes of a cloud in their ranges times their weights, (N, k); None if all are constant."""
        columns = [np.float32(weight) * item.values(cloud) for item, weight in self.weighted]
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
