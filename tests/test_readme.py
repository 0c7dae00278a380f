"""What the README shows works and says what was measured."""

import re
import shlex
import sys
from pathlib import Path

import pytest

import gppcs
from gppcs.app import cli

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def test_python_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (code,) = blocks("python")
    exec(compile(code, "README.md", "exec"), {})


@pytest.mark.slow
def test_commands_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = [shlex.split(line, comments=True) for block in blocks("console") for line in block.splitlines()]
    commands = [words for words in lines if words and Path(words[0]).name == "gppcs"]
    assert len(commands) >= 9
    for words in commands:
        small = ["2000" if word == "400000" else word for word in words[1:]]
        small = ["500" if word == "5000" else word for word in small]
        force = ["--force"] if small[0] in ("simplify", "sample") else []
        monkeypatch.setattr(sys, "argv", ["gppcs", *small, *force])
        with pytest.raises(SystemExit) as exit_:
            cli.main()
        assert exit_.value.code == 0, words


def test_test_commands_are_those_of_make():
    makefile = (ROOT / "Makefile").read_text()
    plain = next(line for block in blocks("console") for line in block.splitlines() if "ruff" in line)
    recipe = re.search(r"\ntest:.*?\n\n", makefile, re.DOTALL).group()
    for command in plain.split(" && "):
        assert command.replace(".venv/bin", "$(BIN)") in recipe
    assert (ROOT / ".ci" / "run").read_text().splitlines()[-1] == "make test test-all"


def test_tables_are_those_of_the_benchmarks():
    results = "".join(path.read_text() for path in (ROOT / "benchmarks" / "results").glob("*.md"))
    section = README.split("## Figures")[1]
    rows = [line for line in section.splitlines() if line.startswith("|")]
    assert len(rows) > 5
    for row in rows:
        assert row in results


@pytest.mark.parametrize("page", ["README.md", *(f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md"))])
def test_links_lead_somewhere(page):
    source = ROOT / page
    for target in re.findall(r"\]\(([^)#]+)\)", source.read_text()):
        assert (source.parent / target).exists(), target


def test_the_page_on_evaluation_defines_each_figure_as_the_code_does():
    page = (ROOT / "docs" / "evaluation.md").read_text()
    for report in (gppcs.Report, gppcs.Rebuilt):
        rows = [
            f"| `{name}` | {figure.unit} | {figure.better or ''} | {figure.definition} |"
            for name, figure in gppcs.figures_of(report).items()
        ]
        assert "\n".join(rows) in page


def test_the_pages_quote_the_benchmarks():
    results = "".join(path.read_text() for path in (ROOT / "benchmarks" / "results").glob("*.md"))
    section = (ROOT / "docs" / "evaluation.md").read_text().split("## An error for features")[1].split("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("| ") and "---" not in line]
    assert len(rows) > 5
    for row in rows:
        assert row.removesuffix(" |") in results
