"""What the package says of itself in different files agrees: versions, requirements, Pythons, the date of a release."""

import re
import tomllib
from pathlib import Path

import gppcs

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_changelog_and_citation_agree_on_the_release():
    """Until the first release neither has a date."""
    citation = dict(re.findall(r"^(version|date-released): (.+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE))
    changelog = (ROOT / "CHANGELOG.md").read_text()
    releases = re.findall(r"^## \[(\d[\d.]*)\] - (\d{4}-\d\d-\d\d)$", changelog, re.MULTILINE)
    assert citation.get("version") == (releases[0][0] if releases else gppcs.__version__)
    assert citation.get("date-released") == (releases[0][1] if releases else None)


def test_the_source_distribution_has_all_that_pages_link_to():
    included = PROJECT["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]
    for page in [ROOT / "README.md", *ROOT.glob("docs/*.md"), *ROOT.glob("research/*.md")]:
        for target in re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text()):
            path = page.parent.joinpath(target).resolve().relative_to(ROOT)
            assert path.parts[0] in included, target


def test_workflows_try_every_python_that_is_promised():
    pythons = {each.split(" :: ")[-1] for each in PROJECT["project"]["classifiers"] if " :: 3." in each}
    lowest = min(pythons, key=lambda version: int(version[2:]))
    assert PROJECT["project"]["requires-python"] == f">={lowest}"
    for name in ("tests.yml", "release.yml"):
        matrix = re.search(r"python: \[(.*)\]", (ROOT / ".github" / "workflows" / name).read_text())[1]
        assert set(re.findall(r"[\d.]+", matrix)) == pythons


def test_the_recipe_of_conda_has_the_requirements_of_the_package():
    recipe = (ROOT / "packaging" / "recipe.yaml").read_text()
    assert f"\n  version: {gppcs.__version__}\n" in recipe
    run = recipe.partition("  run:\n")[2].partition("\n\n")[0]
    needed = dict(re.findall(r"- ([\w-]+) >=([\d.]+)$", run, re.MULTILINE))
    stated = dict(
        re.fullmatch(r"([\w-]+)(?:\[\w+\])?>=(.+)", each).groups() for each in PROJECT["project"]["dependencies"]
    )
    assert needed == stated
