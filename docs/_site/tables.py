"""The tables that `make docs` writes anew: options in docs/usage.md, from the parser; names in docs/api.md."""

import inspect
import re
from pathlib import Path

import typer.main

import gppcs
from gppcs.app.program import program

DOCS = Path(__file__).parents[1]


def options_table():
    """Return the rows for all options of `gppcs simplify`."""
    rows = ["| option | meaning |", "|---|---|"]
    for option in typer.main.get_command(program()).commands["simplify"].params:
        if option.param_type_name == "option":
            names = ", ".join(f"`{name}`" for name in sorted(option.opts, key=len, reverse=True))
            value = "" if option.is_flag else f" `{(option.metavar or 'N').replace('|', ' or ')}`"
            meaning = option.help.replace("|", "\\|").replace("{", "`{").replace("}", "}`")
            rows.append(f"| {names}{value} | {meaning} |")
    return "\n".join(rows) + "\n"


def names_table():
    """Return a row for each public function and class: its parameters and the first sentence of its docstring."""
    rows = ["| name | parameters | what it is |", "|---|---|---|"]
    for name in gppcs.__all__:
        thing = getattr(gppcs, name)
        if callable(thing):
            parameters = [f"{parameter}" for parameter in _parameters(thing) if not parameter.startswith("_")]
            sentence = re.split(r"(?<=[.])\s", " ".join(inspect.getdoc(thing).split()))[0]
            rows.append(f"| `{name}` | {', '.join(parameters)} | {sentence} |")
    return "\n".join(rows) + "\n"


def _parameters(thing):
    try:
        return inspect.signature(thing).parameters
    except ValueError:  # of a class that Python itself makes
        return ()


TABLES = {DOCS / "usage.md": ("options", options_table), DOCS / "api.md": ("names", names_table)}


def with_table(path):
    """Return the text of a page with its table anew."""
    name, table = TABLES[path]
    begin, end = f"<!-- {name}: made by `make docs` -->\n", f"<!-- end of {name} -->"
    pattern = f"{re.escape(begin)}.*?{re.escape(end)}"
    return re.sub(pattern, lambda _: begin + table() + end, path.read_text(), flags=re.DOTALL)


if __name__ == "__main__":
    for path in TABLES:
        path.write_text(with_table(path))
