"""The table of options in docs/usage.md, made from the parser: `make docs` writes it anew."""

import re
from pathlib import Path

import typer.main

from gppcs.app.program import app

PAGE = Path(__file__).parents[1] / "usage.md"
BEGIN, END = "<!-- options: made by `make docs` -->\n", "<!-- end of options -->"


def table():
    """Return the rows for all options of `gppcs simplify`."""
    rows = ["| option | meaning |", "|---|---|"]
    for option in typer.main.get_command(app).commands["simplify"].params:
        if option.param_type_name == "option":
            names = ", ".join(f"`{name}`" for name in sorted(option.opts, key=len, reverse=True))
            value = "" if option.is_flag else f" `{(option.metavar or 'N').replace('|', ' or ')}`"
            meaning = option.help.replace("|", "\\|").replace("{", "`{").replace("}", "}`")
            rows.append(f"| {names}{value} | {meaning} |")
    return "\n".join(rows) + "\n"


def with_table(text):
    """Return the text of the page with the table in its place."""
    return re.sub(f"{re.escape(BEGIN)}.*?{re.escape(END)}", lambda _: BEGIN + table() + END, text, flags=re.DOTALL)


if __name__ == "__main__":
    PAGE.write_text(with_table(PAGE.read_text()))
