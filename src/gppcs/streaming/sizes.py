"""Read amounts of memory, as people write them."""

from __future__ import annotations

import re
from decimal import Decimal

from gppcs.errors import ParameterError, shown

_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "t": 10**12, "ki": 2**10, "mi": 2**20, "gi": 2**30, "ti": 2**40}


def bytes_of(memory: int | str) -> int:
    """Return a number of bytes that is written with a unit."""
    text = str(memory) if isinstance(memory, int | str) and not isinstance(memory, bool) else ""
    found = re.fullmatch(r"\s*(\d+|\d*\.\d+)\s*([kmgt]i?)?b?\s*", text, re.IGNORECASE | re.ASCII)
    exact = Decimal(found[1]) * _UNITS[(found[2] or "").lower()] if found else Decimal(0)  # floats could overflow
    size = round(exact)
    if size <= 0 or (found and not found[2] and exact != size):
        raise ParameterError(f"expected an amount of memory such as 4GB or 512MB, found {shown(memory)}")
    return size
