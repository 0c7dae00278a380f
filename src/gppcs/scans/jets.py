"""Second-order jets: functions of two parameters with their exact derivatives (forward differentiation)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class Jet:
    """Values of a function of (u, v) at N places, with all derivatives up to order two.

    Jets support +, - and * with jets, numbers and (N,) arrays, which count as constants.
    """

    def __init__(self, parts: NDArray[np.float64]) -> None:
        self.parts = parts

    @classmethod
    def variables(cls, u: NDArray[np.float64], v: NDArray[np.float64]) -> tuple[Jet, Jet]:
        """Return the two parameters as jets.

        Shapes: u, v (N,).
        """
        parts = np.zeros((2, 6, len(u)))
        parts[0, 0], parts[0, 1] = u, 1.0
        parts[1, 0], parts[1, 2] = v, 1.0
        return cls(parts[0]), cls(parts[1])

    @property
    def value(self) -> NDArray[np.float64]:
        """Values of the function, (N,), float64."""
        value: NDArray[np.float64] = self.parts[0]
        return value

    def _shifted(self, offset: float | NDArray[np.float64], sign: float) -> Jet:
        """Return sign * f + offset."""
        parts = sign * self.parts
        parts[0] += offset
        return Jet(parts)

    def __add__(self, other: Jet | float | NDArray[np.float64]) -> Jet:
        return Jet(self.parts + other.parts) if isinstance(other, Jet) else self._shifted(other, 1.0)

    def __sub__(self, other: Jet | float | NDArray[np.float64]) -> Jet:
        return Jet(self.parts - other.parts) if isinstance(other, Jet) else self._shifted(-other, 1.0)

    def __rsub__(self, other: float) -> Jet:
        return self._shifted(other, -1.0)

    def __neg__(self) -> Jet:
        return Jet(-self.parts)

    def __mul__(self, other: Jet | float | NDArray[np.float64]) -> Jet:
        if not isinstance(other, Jet):
            return Jet(self.parts * other)
        f, fu, fv, fuu, fuv, fvv = self.parts
        g, gu, gv, guu, guv, gvv = other.parts
        parts = np.empty_like(self.parts)
        parts[0] = f * g
        parts[1] = fu * g + f * gu
        parts[2] = fv * g + f * gv
        parts[3] = fuu * g + 2.0 * fu * gu + f * guu
        parts[4] = fuv * g + fu * gv + fv * gu + f * guv
        parts[5] = fvv * g + 2.0 * fv * gv + f * gvv
        return Jet(parts)

    __radd__ = __add__
    __rmul__ = __mul__

    def _chain(self, h: NDArray[np.float64], h1: NDArray[np.float64], h2: NDArray[np.float64]) -> Jet:
        """Return h(f), given the values of h, h' and h'' at f, (N,) each."""
        _, fu, fv, fuu, fuv, fvv = self.parts
        parts = np.empty_like(self.parts)
        parts[0] = h
        parts[1] = h1 * fu
        parts[2] = h1 * fv
        parts[3] = h2 * fu * fu + h1 * fuu
        parts[4] = h2 * fu * fv + h1 * fuv
        parts[5] = h2 * fv * fv + h1 * fvv
        return Jet(parts)

    def squared(self) -> Jet:
        """Return f²."""
        f = self.value
        return self._chain(f * f, 2.0 * f, np.full_like(f, 2.0))

    def sqrt(self) -> Jet:
        """Return √f, for f > 0."""
        root = np.sqrt(self.value)
        return self._chain(root, 0.5 / root, -0.25 / (root * self.value))

    def exp(self) -> Jet:
        """Return e^f."""
        power = np.exp(self.value)
        return self._chain(power, power, power)

    def sin(self) -> Jet:
        """Return sin f."""
        sine = np.sin(self.value)
        return self._chain(sine, np.cos(self.value), -sine)

    def cos(self) -> Jet:
        """Return cos f."""
        cosine = np.cos(self.value)
        return self._chain(cosine, -np.sin(self.value), -cosine)

    def clipped(self, low: float, high: float) -> Jet:
        """Return f clipped to [low, high]; where it is clipped, its derivatives are zero."""
        parts = np.where((self.value > low) & (self.value < high), self.parts, 0.0)
        parts[0] = np.clip(self.value, low, high)
        return Jet(parts)

    def where_higher(self, other: Jet) -> Jet:
        """Return the greater of two functions at each place; they meet in a sharp edge."""
        return Jet(np.where(self.value > other.value, self.parts, other.parts))

    def at(self, places: NDArray[np.bool_]) -> Jet:
        """Return the jet at some of its places.

        Shapes: places (N,).
        """
        return Jet(self.parts[:, places])

    def raised_at(self, places: NDArray[np.bool_], amount: Jet) -> Jet:
        """Return f with an amount added at some of its places.

        Shapes: places (N,).
        """
        parts = self.parts.copy()
        parts[:, places] += amount.parts
        return Jet(parts)
