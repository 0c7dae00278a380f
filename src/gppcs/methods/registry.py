"""The methods by name: those of gppcs and those of installed packages, in the entry point group `gppcs.methods`."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from functools import cache
from typing import TYPE_CHECKING

from gppcs.errors import ParameterError
from gppcs.methods.method import Method

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint


class Registry(Mapping[str, type[Method]]):
    """All methods by name. Installed packages are looked up only for a name that is not built in, or to list all.

    An alias is another name of a built-in method. It is not listed.
    """

    def __init__(self, built_in: Mapping[str, type[Method]], aliases: Mapping[str, str]) -> None:
        self.built_in = built_in
        self.aliases = aliases

    def __getitem__(self, name: str) -> type[Method]:
        name = self.aliases.get(name, name)
        return self.built_in[name] if name in self.built_in else _load(_entries()[name])

    def names(self) -> list[str]:
        """Return the names of all methods and aliases, without importing a package."""
        return list(dict.fromkeys([*self.built_in, *self.aliases, *_entries()]))

    def __iter__(self) -> Iterator[str]:
        yield from self.built_in
        yield from (name for name in _usable() if name not in self.built_in)

    def __len__(self) -> int:
        return sum(1 for _ in self)


@cache
def _entries() -> dict[str, EntryPoint]:
    from importlib.metadata import entry_points

    return {entry.name: entry for entry in entry_points(group="gppcs.methods")}


@cache
def _usable() -> list[str]:
    """Return the names of the methods of installed packages, with a note on each that cannot be used."""
    names = []
    for name, entry in _entries().items():
        try:
            _load(entry)
        except ParameterError as error:
            warnings.warn(str(error), stacklevel=2)
        else:
            names.append(name)
    return names


def _load(entry: EntryPoint) -> type[Method]:
    try:
        method = entry.load()
    except Exception as error:  # whatever the code of the package raises
        reason = f"{type(error).__name__}: {error}"
    else:
        if isinstance(method, type) and issubclass(method, Method) and method.name == entry.name:
            return method
        reason = f"expected a subclass of gppcs.Method named {entry.name!r}, found {method!r}"
    package = entry.dist.name if entry.dist else entry.value
    raise ParameterError(f"the method {entry.name!r} of the package {package!r} cannot be used: {reason}")
