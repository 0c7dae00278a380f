"""`gppcs methods`."""

from __future__ import annotations

import dataclasses
import inspect
from typing import Annotated, Any

import typer

from gppcs.app.printing import Json, print_json
from gppcs.methods import METHODS, Method, method_named

EPILOG = "[bold]Examples[/bold]\n\ngppcs methods\n\ngppcs methods wlop"


def methods(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="The one to explain in full.", show_default=False)
    ] = None,
    as_json: Json = False,
) -> None:
    """List the methods with their sources and parameters, or explain one and what each of its parameters does."""
    chosen = list(METHODS.values()) if name is None else [type(method_named(name))]
    if as_json:
        for method in chosen:
            print_json(_record(method))
    elif name is None:
        _list(chosen)
    else:
        _explain(chosen[0])


def _record(method: type[Method]) -> dict[str, Any]:
    """Return a method for machines."""
    return {
        "name": method.name,
        "summary": method.summary,
        "source": method.source,
        "parameters": dataclasses.asdict(method()),
        "meanings": {key: parameter.meaning for key, parameter in method.parameters().items()},
    }


def _list(chosen: list[type[Method]]) -> None:
    """Print what there is."""
    from gppcs.app.console import print_table

    for method in chosen:
        rows = {"source": method.source}
        if parameters := method.parameters():
            rows["parameters"] = ", ".join(f"{key}={parameter.default}" for key, parameter in parameters.items())
        print_table(f"{method.name}: {method.summary}", rows)
    typer.echo("\ngppcs methods NAME explains the parameters of one.")


def _explain(method: type[Method]) -> None:
    """Print the docstring of a method."""
    from gppcs.app.console import print_paragraphs

    description, _, _ = (inspect.getdoc(method) or "").partition("\nParameters\n---")
    paragraphs = [(f"{method.name}: {method.summary}", f"{description}\n\nSource: {method.source}")]
    for key, parameter in method.parameters().items():
        paragraphs.append((f"{key} ({parameter.kind}, default {parameter.default})", parameter.meaning))
    if len(paragraphs) == 1:
        paragraphs.append(("no parameters", ""))
    print_paragraphs(paragraphs)
