"""Every public name has an example that works, and a docstring that tells its parameters, results and errors."""

import dataclasses
import doctest
import inspect
import re

import pytest

import gppcs

# Names without a docstring of their own are explained by that of the package.
DOCUMENTED = {name: getattr(gppcs, name) for name in gppcs.__all__ if hasattr(getattr(gppcs, name), "__module__")}
NEEDED = dict.fromkeys(("Rebuilt", "MeshReport", "evaluate_mesh"), "pymeshlab") | {
    "Simplifier": "sklearn"
}  # extras that examples need
ERRORS = {name for name in vars(gppcs.errors) if name.endswith("Error")}


@pytest.mark.parametrize("name", ["gppcs", *DOCUMENTED])
def test_examples_work(name, tmp_path, monkeypatch):
    if name in NEEDED:
        pytest.importorskip(NEEDED[name], reason=f"the example needs {NEEDED[name]}")
    monkeypatch.chdir(tmp_path)
    report = []
    for test in doctest.DocTestFinder().find(DOCUMENTED.get(name, gppcs), name, extraglobs={"gppcs": gppcs}):
        doctest.DocTestRunner().run(test, out=report.append)
    assert not report, "".join(report)


@pytest.mark.parametrize("name", gppcs.__all__)
def test_each_name_has_an_example(name):
    text = f"{gppcs.__doc__}\n{inspect.getdoc(DOCUMENTED.get(name, gppcs))}"
    examples = doctest.DocTestParser().get_examples(text)
    assert any(re.search(rf"\b{name}\b", example.source + example.want) for example in examples)


def functions():
    """Yield the name, the function and the class, if any, of each public function and each method of a public class."""
    for name, value in DOCUMENTED.items():
        if inspect.isfunction(value):
            yield name, value
        else:
            for key, member in vars(value).items():
                function = getattr(member, "__func__", member)
                if inspect.isfunction(function) and not key.startswith("_"):
                    yield f"{name}.{key}", function


FUNCTIONS = dict(functions())


def sections(value):
    """Return the sections of a NumPy docstring, as the names that stand at the margin of each."""
    parts = re.split(r"^(\w+)\n-+\n", inspect.getdoc(value) or "", flags=re.MULTILINE)
    return {
        title: {name for line in re.findall(r"^\S.*", text, re.MULTILINE) for name in line.split(" : ")[0].split(", ")}
        for title, text in zip(parts[1::2], parts[2::2], strict=True)
    }


def raised(function):
    """Return the names of our errors that a function raises itself."""
    return set(re.findall(r"raise (\w+)\(", inspect.getsource(function))) & ERRORS


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_tell_their_parameters_results_and_errors(name):
    function = FUNCTIONS[name]
    told = sections(function)
    parameters = [key for key in inspect.signature(function).parameters if key not in ("self", "cls")]
    assert not set(parameters) - told.get("Parameters", set())
    if inspect.signature(function).return_annotation not in ("None", None):
        assert "Returns" in told or "Yields" in told
    assert not raised(function) - told.get("Raises", set())


@pytest.mark.parametrize("name", [name for name, value in DOCUMENTED.items() if inspect.isclass(value)])
def test_classes_tell_their_fields_and_errors(name):
    value = DOCUMENTED[name]
    told = sections(value)
    fields = [field.name for field in dataclasses.fields(value)] if dataclasses.is_dataclass(value) else []
    assert not set(fields) - told.get("Parameters", set()) - told.get("Attributes", set())
    if "__post_init__" in vars(value):
        assert not raised(value.__post_init__) - told.get("Raises", set())
