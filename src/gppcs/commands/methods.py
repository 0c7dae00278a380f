"""`gppcs methods`."""

from __future__ import annotations

import dataclasses

from gppcs.commands.output import Json, print_json
from gppcs.methods import METHODS


def methods(as_json: Json = False) -> None:
    """List the methods with their sources and parameters."""
    if as_json:
        for method in METHODS.values():
            print_json(
                {
                    "name": method.name,
                    "summary": method.summary,
                    "source": method.source,
                    "parameters": dataclasses.asdict(method()),
                }
            )
        return
    from gppcs.console import print_table

    for method in METHODS.values():
        rows = {"source": method.source}
        parameters = dataclasses.asdict(method())
        if parameters:
            rows["parameters"] = ", ".join(f"{key}={value}" for key, value in parameters.items())
        print_table(f"{method.name}: {method.summary}", rows)
