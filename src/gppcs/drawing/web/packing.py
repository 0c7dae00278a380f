"""Packs arrays for the page: whole numbers of few bits, as text that compresses well."""

from __future__ import annotations

import base64
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

UNKNOWN = 2**16 - 1  # stands for NaN and infinity among values
LARGEST_NUMBER = 2**16 - 1  # of coordinates

Array = NDArray[np.float64]


class Blocks:
    """The packed arrays of a page.

    Attributes
    ----------
    texts : list of str
        The packed arrays in base64.
    """

    def __init__(self) -> None:
        self.texts: list[str] = []

    def add(self, array: NDArray[np.unsignedinteger[Any]]) -> str:
        """Pack an array.

        Each column is written as differences from row to row, these as planes of bytes from the lowest, and all planes
        are deflated (zlib).

        Shapes: array (N,) or (N, C).
        """
        columns = array.reshape(len(array), -1).T
        differences = np.diff(columns, axis=1, prepend=columns.dtype.type(0))  # modulo the range of the type
        little = np.ascontiguousarray(differences, dtype=differences.dtype.newbyteorder("<"))
        planes = little.view(np.uint8).reshape(*little.shape, -1).transpose(0, 2, 1)
        self.texts.append(base64.b64encode(zlib.compress(planes.tobytes(), 6)).decode("ascii"))
        return f"block{len(self.texts) - 1}"


@dataclass(frozen=True)
class Quantised:
    """Coordinates or values as whole numbers: the original is about low + step * number.

    Attributes
    ----------
    numbers : (N,) or (N, 3) array, uint16
    low, step : array, float64
        Of one number, or of one for each column.
    """

    numbers: NDArray[np.uint16]
    low: Array
    step: Array


def quantised_points(points: Array) -> Quantised:
    """Return coordinates in 16 bits of their bounding box.

    Shapes: points (N, 3).
    """
    low = points.min(axis=0)
    # Divided first: the extent can exceed the largest float.
    step = points.max(axis=0) / LARGEST_NUMBER - low / LARGEST_NUMBER
    return Quantised(_numbers(points, low, step, LARGEST_NUMBER), low, step)


def quantised_values(values: NDArray[Any]) -> Quantised:
    """Return values in 16 bits of their range; whole numbers stay exact if they fit.

    Shapes: values (N,).
    """
    numbers = np.full(len(values), UNKNOWN, dtype=np.uint16)
    floats = values.astype(np.float64)
    known = np.isfinite(floats)
    if not known.any():
        return Quantised(numbers, np.array(0.0), np.array(0.0))
    low, high = floats[known].min(), floats[known].max()
    step = high / (UNKNOWN - 1) - low / (UNKNOWN - 1)
    if not np.issubdtype(values.dtype, np.floating) and step < 1:
        step = np.float64(1)
    numbers[known] = _numbers(floats[known], low, step, UNKNOWN - 1)
    return Quantised(numbers, np.asarray(low), np.asarray(step))


def octahedral(normals: Array) -> NDArray[np.uint8]:
    """Return directions as points of a square, in 8 bits for each side.

    The sphere is projected onto an octahedron, whose lower half is folded out (Cigolle et al. 2014).

    Shapes: normals (N, 3); returns (N, 2).
    """
    known = np.isfinite(normals).all(axis=1) & (normals != 0).any(axis=1)
    directions = np.where(known[:, None], normals, (0.0, 0.0, 1.0))
    directions = directions / np.abs(directions).max(axis=1, keepdims=True)
    directions /= np.abs(directions).sum(axis=1, keepdims=True)
    flat = directions[:, :2]
    folded = (1.0 - np.abs(flat[:, ::-1])) * np.where(flat < 0, -1.0, 1.0)
    flat = np.where(directions[:, 2:] < 0, folded, flat)
    return np.round((flat + 1.0) * 127.5).astype(np.uint8)


def packed_faces(faces: NDArray[np.int64]) -> NDArray[np.uint32]:
    """Return triangles as numbers whose differences from row to row are small, so that they take little room.

    Shapes: faces (F, 3); returns (F, 3).
    """
    lowest = faces.argmin(axis=1)[:, None]
    turned = np.take_along_axis(faces, (lowest + np.arange(3)) % 3, axis=1)
    turned = turned[np.lexsort(turned.T[::-1])]
    return np.column_stack([turned[:, 0], (turned[:, 1:] - turned[:, :1]).cumsum(axis=0)]).astype(np.uint32)


def _numbers(values: Array, low: Array, step: Array, largest: int) -> NDArray[np.uint16]:
    """Return the whole numbers of values; all are 0 where the step is."""
    with np.errstate(divide="ignore", invalid="ignore"):
        numbers = np.where(step > 0, (values / 2 - low / 2) / (step / 2), 0.0)  # halves: the range can overflow
    return np.clip(np.round(numbers), 0, largest).astype(np.uint16)
