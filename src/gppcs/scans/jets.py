"""Second-order jets: functions of two parameters with their exact derivatives (forward differentiation)."""

from __future__ import annotations

import numpy as np

from gppcs.engine.arrays import Flags, Floats

# The first derivatives whose product is a term of each second derivative: uu, uv and vv.
FIRST, SECOND = [1, 1, 2], [1, 2, 2]


class Jet:
    """Floats of a function of (u, v) at N places, and its derivatives along u, v, uu, uv and vv: parts, (6, N)."""

    def __init__(self, parts: Floats) -> None:
        self.parts = parts

    @classmethod
    def variables(cls, u: Floats, v: Floats) -> tuple[Jet, Jet]:
        """Return the two parameters, (N,) each, as jets."""
        parts = np.zeros((2, 6, len(u)))
        parts[0, 0], parts[0, 1] = u, 1.0
        parts[1, 0], parts[1, 2] = v, 1.0
        return cls(parts[0]), cls(parts[1])

    @property
    def value(self) -> Floats:
        """Floats of the function, (N,)."""
        return self.parts[0]

    def __add__(self, other: Jet | float | Floats) -> Jet:
        if isinstance(other, Jet):
            return Jet(self.parts + other.parts)
        parts = self.parts.copy()
        parts[0] += other
        return Jet(parts)

    def __neg__(self) -> Jet:
        return Jet(-self.parts)

    def __sub__(self, other: Jet | float | Floats) -> Jet:
        return self + -other

    def __rsub__(self, other: float) -> Jet:
        return -self + other

    def __mul__(self, other: Jet | float | Floats) -> Jet:
        if not isinstance(other, Jet):
            return Jet(self.parts * other)
        f, g = self.parts, other.parts
        parts = f * g[0] + f[0] * g
        parts[0] = f[0] * g[0]
        parts[3:] += f[FIRST] * g[SECOND] + f[SECOND] * g[FIRST]
        return Jet(parts)

    __radd__ = __add__
    __rmul__ = __mul__

    def _chain(self, h: Floats, h1: Floats, h2: Floats | float) -> Jet:
        """Return h(f), given the values of h, h' and h'' at f."""
        parts = h1 * self.parts
        parts[0] = h
        parts[3:] += h2 * self.parts[FIRST] * self.parts[SECOND]
        return Jet(parts)

    def squared(self) -> Jet:
        """Return f²."""
        return self._chain(self.value**2, 2.0 * self.value, 2.0)

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

    def clipped(self, lower: float, upper: float) -> Jet:
        """Return f clipped to [lower, upper]; where it is clipped, its derivatives are zero."""
        parts = np.where((self.value > lower) & (self.value < upper), self.parts, 0.0)
        parts[0] = np.clip(self.value, lower, upper)
        return Jet(parts)

    def where_higher(self, other: Jet) -> Jet:
        """Return the greater of two functions at each place; they meet in a sharp edge."""
        return Jet(np.where(self.value > other.value, self.parts, other.parts))

    def at(self, mask: Flags) -> Jet:
        """Return the jet where a mask, (N,), is true."""
        return Jet(self.parts[:, mask])

    def raised_at(self, mask: Flags, amount: Jet) -> Jet:
        """Return f with an amount added where a mask, (N,), is true."""
        parts = self.parts.copy()
        parts[:, mask] += amount.parts
        return Jet(parts)
