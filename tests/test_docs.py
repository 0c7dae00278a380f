"""What README and docs show works, names what exists, and quotes what was measured."""

import importlib.util
import re
import shlex
import webbrowser
from functools import cache
from pathlib import Path

import pytest
import typer.main

import gppcs
from gppcs.app import program
from gppcs.evaluation.report import DetailErrors, MeshReport, Rebuilt
from gppcs.io import FORMATS
from gppcs.methods import Feature
from gppcs.methods.parameters import parameters_of
from las_file import las_of
from optional import import_or_skip

ROOT = Path(__file__).parents[1]
FOUND = [*ROOT.glob("docs/*.md"), *ROOT.glob("research/*.md"), ROOT / "README.md"]
PAGES = sorted(path.relative_to(ROOT).as_posix() for path in FOUND)
# Points of the scans, so that the examples run in seconds.
SMALLER = dict.fromkeys(("400000", "400k", "100k"), "20000")
# Tables of measurements.
QUOTED = {
    "README.md": 1,
    "docs/evaluation.md": 1,
    "docs/results.md": 3,
    "research/cost.md": 1,
    "research/experiments.md": 1,
}


@cache
def text(page):
    return (ROOT / page).read_text()


def blocks(page, language):
    return re.findall(rf"```{language}\n(.*?)```", text(page), re.DOTALL)


def console_lines(page):
    lines = [shlex.split(line, comments=True) for block in blocks(page, "console") for line in block.splitlines()]
    return [line for line in lines if line]


def inline_code(page):
    return re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", text(page), flags=re.DOTALL))


def tables(page):
    """Return the tables of a page, each as its lines."""
    return [table.strip().splitlines() for table in re.findall(r"(?:^\|.*\n)+", text(page), re.MULTILINE)]


def results():
    return "".join(path.read_text() for path in (ROOT / "benchmarks" / "results").glob("*.md"))


@cache
def options():
    """Return the options of all commands."""
    commands = typer.main.get_command(program.program()).commands
    names = [[*each.opts, *each.secondary_opts] for command in commands.values() for each in command.params]
    return {option for options in names for option in options if option.startswith("-")}


@pytest.fixture
def user_folder(tmp_path, monkeypatch):
    """A folder with a user's scan and something that was made of it."""
    cloud = gppcs.sample("medallion", n_points=2000)
    gppcs.write(tmp_path / "scan.ply", cloud)
    gppcs.write(tmp_path / "share.ply", gppcs.simplify(cloud, n_points=500, method="random").cloud)
    las_of(cloud.points, 0).write(tmp_path / "scan.laz")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(webbrowser, "open", lambda page: True)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))


SLOW = {"docs/large-files.md": pytest.mark.slow}  # it starts processes
WORK = "docs/where-you-work.md"


@pytest.mark.parametrize(
    "page", [pytest.param(page, marks=SLOW.get(page, ())) for page in PAGES if blocks(page, "python") and page != WORK]
)
def test_python_runs(page, user_folder):
    has_meshlab = importlib.util.find_spec("pymeshlab")
    code = "\n".join(block for block in blocks(page, "python") if has_meshlab or "import pymeshlab" not in block)
    code = compile(code.replace("depth=8", "depth=5"), page, "exec")  # a quick reconstruction
    for _ in range(2 if page == "README.md" else 1):  # whoever tries the README tries it twice
        exec(code, {"__name__": "page"})


def examples():
    """Yield the code and what it prints of each section on other programs."""
    for section in re.split(r"^## ", text(WORK), flags=re.MULTILINE):
        if code := re.search(r"```python\n(.*?)```\n\n```text\n(.*?)```", section, re.DOTALL):
            yield pytest.param(*code.groups(), id=section.splitlines()[0])


@pytest.mark.parametrize(("code", "printed"), [*examples()])
def test_code_inside_other_programs_prints_what_is_shown(code, printed, tmp_path, monkeypatch, capsys):
    for package in re.findall(r"^(?:from|import) (\w+)", code, re.MULTILINE):
        import_or_skip(package)
    monkeypatch.chdir(tmp_path)
    exec(compile(code, WORK, "exec"), {"__name__": "page"})
    assert capsys.readouterr().out == printed


def commands(page):
    return [line for line in console_lines(page) if Path(line[0]).name == "gppcs"]


@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)])
@pytest.mark.slow
def test_commands_run_as_pasted(page, tmp_path, monkeypatch):
    """In order, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(webbrowser, "open", lambda page: True)
    for words in commands(page):
        assert program.run([SMALLER.get(word, word) for word in words[1:]]) == 0, words


@pytest.mark.parametrize("page", PAGES)
def test_options_exist(page):
    code = [code for code in inline_code(page) if not code.startswith(("pip", "uv", ".venv", "pdal"))]
    code += [" ".join(line) for line in console_lines(page) if Path(line[0]).name == "gppcs"]
    for option in re.findall(r"(?<![\w-])--[a-z][a-z-]*", " ".join(code)):
        assert option in options() | {"--help", "--version", "--install-completion", "--show-completion"}, option


@pytest.fixture
def made():
    """What `make docs` writes anew."""
    spec = importlib.util.spec_from_file_location("tables", ROOT / "docs" / "_site" / "tables.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_pages_have_the_options_of_the_parser_the_public_names_and_the_seconds_of_the_benchmarks(made):
    """After a benchmark of speed or a change of options, `python docs/_site/tables.py` writes them anew."""
    for page in {*made.TABLES, *made.SENTENCES}:
        assert made.renewed(page) == text(page)


def test_every_format_is_listed():
    for known in FORMATS:
        for suffix in known.suffixes:
            assert f"`{suffix}`" in text("docs/usage.md")


def test_the_page_on_methods_has_each_and_names_parameters_that_exist():
    sections = dict(re.findall(r"^## ([\w-]+)\n(.*?)(?=^## |\Z)", text("docs/methods.md"), re.DOTALL | re.MULTILINE))
    assert list(sections) == [*gppcs.METHODS.built_in]
    for name, section in sections.items():
        for setting in re.findall(r"`(\w+)=[^`]+`", section):
            assert setting in parameters_of(gppcs.METHODS[name]), (name, setting)


def test_the_list_of_methods_that_rank_is_complete():
    sentence = re.search(r"takes a method that ranks its points: (.*?)\.", text("docs/ask.md"), re.DOTALL)[1]
    ranking = [name for name, method in gppcs.METHODS.built_in.items() if Feature.RANKING in method.supports]
    assert re.findall(r"`([\w-]+)`", sentence) == ranking
    sections = re.findall(r"^## ([\w-]+)\n(.*?)(?=^## |\Z)", text("docs/methods.md"), re.DOTALL | re.MULTILINE)
    assert [name for name, section in sections if "order is a ranking" in " ".join(section.split())] == ranking


@pytest.mark.parametrize("page", PAGES)
def test_names_of_the_library_exist(page):
    for name in re.findall(r"`(?:help\()?(gppcs(?:\.\w+)+)", text(page)):
        head, *rest = name.split(".")
        thing = importlib.import_module(head)
        for part in rest:
            if not hasattr(thing, part):
                importlib.import_module(f"{thing.__name__}.{part}")
            thing = getattr(thing, part)


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    source = ROOT / page
    for target in re.findall(r"\]\(([^)]+)\)", text(page)):
        if re.match(r"https?://", target):
            continue
        path, _, anchor = target.partition("#")
        linked = source.parent / path if path else source
        assert linked.exists(), target
        if anchor:
            headings = re.findall(r"^#+ (.+)$", linked.read_text(), re.MULTILINE)
            assert anchor in [_slug(heading) for heading in headings], target


def _slug(heading):
    """Return the anchor that the usual forges give a heading."""
    return re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")


@pytest.mark.parametrize("page", QUOTED)
def test_tables_are_those_of_the_benchmarks(page):
    measured = results()
    quoted = [table for table in tables(page) if table[0].removesuffix(" |") in measured]
    assert len(quoted) >= QUOTED[page]
    for table in quoted:
        assert len(table) > 2
        for row in [*table[:1], *table[2:]]:
            assert row.removesuffix(" |") in measured


@pytest.mark.slow
def test_the_picture_of_the_readme_is_drawn_by_its_commands(tmp_path, monkeypatch):
    """Its letters and numbers are those of today; otherwise `make pictures` draws it anew."""
    image = pytest.importorskip("matplotlib.image")
    monkeypatch.chdir(tmp_path)
    for words in commands("README.md")[:3]:
        assert program.run(words[1:]) == 0, words
    drawn, shown = (image.imread(path)[..., :3].mean(axis=2) for path in ("picture.png", ROOT / "docs/picture.png"))
    letters = slice(0, 110)  # rows with the names and the numbers
    assert drawn.shape == shown.shape
    assert (abs(drawn - shown)[letters] > 0.5).sum() < 20  # a digit changes more pixels than that


@pytest.mark.parametrize("figures", [gppcs.Report, MeshReport, Rebuilt, DetailErrors])
def test_the_page_on_evaluation_has_the_definition_of_each_figure(figures):
    """One sentence defines those by area."""
    for name, figure in figures.definitions().items():
        row = f"| `{name}` | {figure.unit} | {figure.better or ''} | {figure.definition} |"
        assert name.endswith("_by_area") or row in text("docs/evaluation.md")


def test_the_page_on_the_api_has_each_public_name():
    named = re.findall(r"^::: gppcs\.(\S+)$", text("docs/api.md"), re.MULTILINE)
    assert set(gppcs.__all__) <= {*named, "CloudLike", "METHODS", "__version__", "errors"}
