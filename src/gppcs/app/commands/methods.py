"""The command `gppcs methods`: list the methods, or explain one."""

from __future__ import annotations

import dataclasses
from typing import Any

import typer

from gppcs.app import options
from gppcs.app.printing import print_json, say
from gppcs.methods import METHODS, Method
from gppcs.methods.parameters import parameters_of

EPILOG = "gppcs methods\n\ngppcs methods wlop"


def methods(
    name: str | None = typer.Argument(
        None,
        metavar="NAME",
        help="A method to explain in full.",
        show_default=False,
        autocompletion=lambda: list(METHODS),
    ),
    as_json: bool = options.JSON,
) -> None:
    """List all methods with their sources and parameters, or explain one method and each of its parameters."""
    from gppcs.amounts.options import method_of

    chosen = list(METHODS.values()) if name is None else [type(method_of(name))]
    if as_json:
        for method in chosen:
            print_json(_record(method))
    elif name is None:
        _list(chosen)
    else:
        _explain(chosen[0])


def _record(method: type[Method]) -> dict[str, Any]:
    """Return the JSON record of a method."""
    return {
        "name": method.name,
        "summary": method.summary,
        "description": method.description,
        "source": method.source,
        "supports": dict(method.supports),
        "parameters": dataclasses.asdict(method()),
        "meanings": {key: parameter.meaning for key, parameter in parameters_of(method).items()},
    }


def _list(chosen: list[type[Method]]) -> None:
    """Print a table for each method."""
    from gppcs.app.console import print_table

    for method in chosen:
        rows = {"source": method.source}
        if parameters := parameters_of(method):
            rows["parameters"] = ", ".join(f"{key}={parameter.default}" for key, parameter in parameters.items())
        print_table(f"{method.name}: {method.summary}", rows)
    say("\ngppcs methods NAME explains a method and its parameters.")


def _explain(method: type[Method]) -> None:
    """Print the description of a method and the meaning of each of its parameters."""
    from gppcs.app.console import print_paragraphs

    text = "\n\n".join(filter(None, [method.description, f"Source: {method.source}"]))
    paragraphs = [(f"{method.name}: {method.summary}", text)]
    paragraphs += [(f"supports {feature}", meaning) for feature, meaning in method.supports.items()]
    for key, parameter in parameters_of(method).items():
        paragraphs.append((f"{key} ({parameter.kind}, default {parameter.default})", parameter.meaning))
    if not parameters_of(method):
        paragraphs.append(("no parameters", ""))
    print_paragraphs(paragraphs)
