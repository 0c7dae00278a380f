"""The examples of every public name work, and its docstring explains all parameters and fields."""

import dataclasses
import doctest
import inspect
import re

import pytest

import gppcs
from gppcs.amounts.options import Options

# Names without a docstring of their own are explained by that of the package.
DOCUMENTED = {name: getattr(gppcs, name) for name in gppcs.__all__ if hasattr(getattr(gppcs, name), "__module__")}
# Packages that examples need.
NEEDED = {"MeshReport": "pymeshlab", "evaluate_mesh": "pymeshlab", "Simplifier": "sklearn"}


@pytest.mark.parametrize("name", ["gppcs", *DOCUMENTED])
def test_examples_work(name, tmp_path, monkeypatch):
    if name in NEEDED:
        pytest.importorskip(NEEDED[name], reason=f"the example needs {NEEDED[name]}")
    monkeypatch.chdir(tmp_path)
    report = []
    for test in doctest.DocTestFinder().find(DOCUMENTED.get(name, gppcs), name, extraglobs={"gppcs": gppcs}):
        doctest.DocTestRunner().run(test, out=report.append)
    assert not report, "".join(report)


def parameters_of(value):
    """Return the parameters of a function, or the fields of a dataclass."""
    if inspect.isfunction(value):
        return set(inspect.signature(value).parameters)
    fields = dataclasses.fields(value) if dataclasses.is_dataclass(value) else ()
    return {field.name for field in fields if "figure" not in field.metadata}  # which `definitions` explains


@pytest.mark.parametrize("name", DOCUMENTED)
def test_docstrings_explain_all_parameters_and_fields(name):
    text = inspect.getdoc(DOCUMENTED[name]) or ""
    explained = {
        parameter.lstrip("*")
        for section in re.findall(r"^(?:Parameters|Attributes)\n-+\n((?:.+\n|\n(?= ))*)", f"{text}\n", re.MULTILINE)
        for line in re.findall(r"^\S.*", section, re.MULTILINE)
        for parameter in line.split(" : ")[0].split(", ")
    }
    assert parameters_of(DOCUMENTED[name]) <= explained


def test_the_docstring_of_simplify_has_the_help_of_its_options():
    """The command shows the help of the fields, editors and the site the docstring."""
    text = " ".join(inspect.getdoc(gppcs.simplify).split())
    names = inspect.signature(gppcs.simplify).parameters
    options = [option for option in dataclasses.fields(Options) if option.name in names]
    assert len(options) > 10
    for option in options:
        assert re.search(rf" {option.name} : [^.]*? {re.escape(option.metadata['help'])} ", text), option.name
