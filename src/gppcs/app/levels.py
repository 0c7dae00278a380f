"""The option `--levels`: simplifications to several sizes at once, of which each is the start of the next."""

from __future__ import annotations

from gppcs.clouds.quantities import size_of
from gppcs.errors import ParameterError, shown

LEVEL = "level"  # the name of the attribute, and of the field in the names of files


def sizes_of(text: str) -> tuple[float, ...]:
    """Return the sizes, from coarse to fine: either fractions of the points or numbers."""
    values = [size_of("levels", value.strip()) for value in text.split(",")]
    if len(values) > 256:
        raise ParameterError(f"expected levels with at most 256 sizes, found {len(values)}")
    sizes = sorted(set(values))
    if sizes[0] < 1 <= sizes[-1]:
        raise ParameterError(f"expected levels with shares or with numbers, found both in {shown(text)}")
    if len(sizes) < len(values):
        raise ParameterError(
            f"expected levels with different sizes below all points, such as 10%,3%,1%, found {shown(text)}"
        )
    return tuple(sizes)


def counts_of(sizes: tuple[float, ...], kept: int) -> list[int]:
    """Return the number of points of each level, of which the finest one has `kept` points."""
    scale = kept / sizes[-1] if sizes[-1] < 1 else 1.0
    return [min(max(1, round(size * scale)), kept) for size in sizes]
