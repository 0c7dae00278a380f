"""The command `gppcs methods`: list the methods, or explain one."""

import dataclasses
from typing import Annotated

from gppcs.app import options
from gppcs.app.printing import emit, say
from gppcs.methods import METHODS, Method
from gppcs.methods.parameters import parameters_of

EPILOG = "gppcs methods\n\ngppcs methods wlop"


def methods(
    name: Annotated[
        str | None,
        options.argument("NAME", "A method to explain in full.", autocompletion=lambda: list(METHODS)),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """List all methods with their sources and parameters, or explain one method and each of its parameters."""
    from gppcs.amounts.options import method_of

    chosen = METHODS.values() if name is None else [type(method_of(name))]
    for method in chosen:
        parameters = parameters_of(method)
        record = {
            "name": method.name,
            "summary": method.summary,
            "description": method.description,
            "source": method.source,
            "supports": dict(method.supports),
            "parameters": dataclasses.asdict(method()),
            "meanings": {key: parameter.meaning for key, parameter in parameters.items()},
        }
        if name is None or as_json:
            defaults = ", ".join(f"{key}={parameter.default}" for key, parameter in parameters.items())
            table = {"source": method.source, "parameters": defaults or "none"}
            emit(record, as_json, False, f"{method.name}: {method.summary}", table)
        else:
            _explain(method)
    if name is None and not as_json:
        say("\ngppcs methods NAME explains a method and its parameters.")


def _explain(method: type[Method]) -> None:
    """Print the description of a method and the meaning of each of its parameters."""
    parts = (f"{method.name}: {method.summary}", method.description, f"Source: {method.source}")
    say("\n\n".join(filter(None, parts)))
    for feature, meaning in method.supports.items():
        say(f"\nsupports {feature}: {meaning}")
    for key, parameter in parameters_of(method).items():
        say(f"\n{key} ({parameter.kind}, default {parameter.default})\n{parameter.meaning}")
