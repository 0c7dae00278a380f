"""How a cloud or a result looks in a notebook.

Drawing is the work of a room above this one, so the package names the functions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

# Set by the package `gppcs`.
html_of: Callable[[Any], str]
show: Callable[..., None]
