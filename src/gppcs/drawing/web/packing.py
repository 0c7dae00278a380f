"""Packs arrays for the page: whole numbers of few bits, as text that compresses well."""

import base64
import zlib
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Floats, Ints
from gppcs.spatial.scaling import bounds

UNKNOWN = 2**16 - 1  # stands for NaN and infinity among values


class Blocks:
    """The packed arrays of a page, in base64."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def add(self, array: NDArray[np.unsignedinteger[Any]]) -> str:
        """Pack an array, (N,) or (N, C), as deflated planes of bytes of its differences; return its name."""
        columns = array.reshape(len(array), -1).T
        differences = np.diff(columns, axis=1, prepend=columns.dtype.type(0))  # modulo the range of the type
        little = np.ascontiguousarray(differences, dtype=differences.dtype.newbyteorder("<"))
        planes = little.view(np.uint8).reshape(*little.shape, -1).transpose(0, 2, 1)
        packer = zlib.compressobj(strategy=zlib.Z_RLE)  # three times as fast: differences hardly repeat, but in runs
        self.texts.append(base64.b64encode(packer.compress(planes.tobytes()) + packer.flush()).decode("ascii"))
        return f"block{len(self.texts) - 1}"


class Quantised(NamedTuple):
    """Coordinates (N, 3) or values (N,) as whole numbers: the original is about lower + step * number."""

    numbers: NDArray[np.uint16]
    lower: Floats
    step: Floats

    def described(self) -> dict[str, Any]:
        """Return what the page needs to know of the numbers, as JSON."""
        return {"low": self.lower.tolist(), "step": self.step.tolist()}


def quantised(values: Floats, largest: int = 2**16 - 1, minimum_step: float = 0.0) -> Quantised:
    """Return finite coordinates (N, 3) or values (N,) as numbers up to the largest."""
    lower, upper = bounds(values) if values.ndim == 2 else (values.min(), values.max())
    # Divided and halved first: the range can exceed the largest float.
    step = np.maximum(upper / largest - lower / largest, minimum_step)
    with np.errstate(divide="ignore", invalid="ignore"):
        numbers = np.where(step > 0, (values / 2 - lower / 2) / (step / 2), 0.0)
    return Quantised(np.clip(np.round(numbers), 0, largest).astype(np.uint16), lower, step)


def quantised_values(values: NDArray[Any]) -> Quantised:
    """Return values (N,) that may be unknown in 16 bits of their range; whole numbers stay exact if they fit."""
    finite = np.isfinite(values)
    floats = values[finite].astype(np.float64) if finite.any() else np.zeros(1)
    held = quantised(floats, UNKNOWN - 1, 0.0 if np.issubdtype(values.dtype, np.floating) else 1.0)
    numbers = np.full(len(values), UNKNOWN, dtype=np.uint16)
    numbers[finite] = held.numbers[: finite.sum()]
    return held._replace(numbers=numbers)


def octahedral(normals: Floats) -> NDArray[np.uint8]:
    """Return directions (N, 3) as points (N, 2) of an unfolded octahedron, in 8 bits each (Cigolle et al. 2014)."""
    usable = np.isfinite(normals).all(axis=1) & (normals != 0).any(axis=1)
    directions = np.where(usable[:, None], normals, (0.0, 0.0, 1.0))
    directions = directions / np.abs(directions).max(axis=1, keepdims=True)
    directions /= np.abs(directions).sum(axis=1, keepdims=True)
    flat = directions[:, :2]
    folded = (1.0 - np.abs(flat[:, ::-1])) * np.where(flat < 0, -1.0, 1.0)
    flat = np.where(directions[:, 2:] < 0, folded, flat)
    return np.round((flat + 1.0) * 127.5).astype(np.uint8)


def packed_faces(faces: Ints) -> NDArray[np.uint32]:
    """Return triangles (F, 3) as numbers whose differences from row to row are small, so that they take little room."""
    lowest = faces.argmin(axis=1)[:, None]
    turned = np.take_along_axis(faces, (lowest + np.arange(3)) % 3, axis=1)
    turned = turned[np.lexsort(turned.T[::-1])]
    return np.column_stack([turned[:, 0], (turned[:, 1:] - turned[:, :1]).cumsum(axis=0)]).astype(np.uint32)
