"""Arguments of wrong types, and parameters of extreme values: our own errors, or a valid result."""

import dataclasses
import inspect
import math
import typing

import numpy as np
import pytest

import gppcs
from gppcs.methods.parameters import parameters_of
from meshes import hull_mesh

OURS = (gppcs.ParameterError, gppcs.InputError, gppcs.errors.FileFormatError)
CLOUD = gppcs.sample("bracket", n_points=300)
BALL = gppcs.sample("sphere", n_points=1000)
HULL = hull_mesh(BALL.points)
WRONG = [None, 3, 1.5, math.nan, True, "text", "5", b"5", {"a": 1}, {1, 2}, [], [1, [2]], (1, 2), object(), len, 1j]
WRONG += [np.zeros(2), np.zeros((2, 2)), np.array("a"), np.array([[None] * 3]), np.zeros((2, 3), dtype="M8[s]")]
WRONG += [[["a", "b", "c"]], 10**400, type]
pytestmark = pytest.mark.usefixtures("default_threads")
EXTREME = {
    str(value): value for value in (math.inf, -math.inf, math.nan, 1e-310, -1e-310, 1e308, 10**6, 2**63 - 1, 2**63)
}
EXTREME["10^400"] = 10**400


def fields_of_type(kind):
    return [
        pytest.param(method, name, id=f"{method.name} {name}")
        for method in gppcs.METHODS.built_in.values()
        for name, hint in typing.get_type_hints(method).items()
        if name in parameters_of(method) and kind in (typing.get_args(hint) or (hint,))
    ]


@pytest.mark.parametrize("value", EXTREME.values(), ids=EXTREME)
@pytest.mark.parametrize(("method", "name"), fields_of_type(float) + fields_of_type(int))
def test_extreme_numbers_are_refused_or_valid(method, name, value):
    """Only the heat kernel is infinitely smooth; what is outside of all ranges is refused."""
    hint = typing.get_type_hints(method)[name]
    is_float = float in (typing.get_args(hint) or (hint,))
    try:
        chosen = method(**{name: value})
    except gppcs.ParameterError as error:
        text = str(error)
        assert text.startswith(f"method '{method.name}': expected {name} to be " if is_float else "method '")
        assert name in text
        assert "\n" not in text
        return
    assert (
        (isinstance(value, int) and not (is_float and value == 10**400))
        or value == 1e-310
        or (name == "nu" and value in (math.inf, 1e308))
    )
    if name == "iterations":
        return  # as many as the user wants
    try:
        result = gppcs.simplify(CLOUD, n_points=60, method=chosen)
    except gppcs.InputError:
        assert isinstance(value, int)  # more neighbours than there are points
        return
    assert len(np.unique(result.indices)) == 60


@pytest.mark.parametrize(("method", "name"), fields_of_type(float))
def test_both_ends_of_each_range_are_valid(method, name):
    """As far as the ranges go, all figures are finite and no warning is raised."""
    (declared,) = (field for field in dataclasses.fields(method) if field.name == name)
    for value in declared.metadata["range"]:
        result = gppcs.simplify(CLOUD, n_points=60, method=method(**{name: value}))
        assert len(np.unique(result.indices)) == 60
        assert all(np.isfinite(figure) for key, figure in result.diagnostics.items() if key != "nu")


CALLS = {  # a public function, and arguments with which it works
    "simplify": {"cloud": "there.ply", "n_points": 9},
    "simplify tolerance": {"cloud": CLOUD, "tolerance": "5:p95", "method": "fps"},
    "simplify spacing": {"cloud": CLOUD, "spacing": 20.0, "method": "fps"},
    "compare": {"cloud": CLOUD, "methods": ["random"], "n_points": 9},
    "find_outliers": {"cloud": CLOUD},
    "evaluate": {"original": CLOUD, "simplified": CLOUD},
    "evaluate_mesh": {"original": BALL, "simplified": HULL},
    "mesh": {"cloud": BALL, "n_points": 9},
    "write_mesh": {"path": "new.stl", "mesh": HULL, "force": True},
    "estimate_features": {"cloud": CLOUD},
    "estimate_normals": {"cloud": CLOUD},
    "info": {"cloud": CLOUD},
    "sample": {"name": "sphere", "n_points": 9},
    "read": {"path": "there.ply"},
    "read_mesh": {"path": "mesh.off"},
    "write": {"path": "new.ply", "cloud": CLOUD, "force": True},
    "PointCloud": {"points": CLOUD.points},
    "Mesh": {"vertices": np.eye(3), "faces": [[0, 1, 2]]},
    "Timer": {},
    "set_threads": {"count": None},
}


def arguments():
    """Yield each call with each argument that is tried in it: all of a function, or the one in the name of a call."""
    for name in CALLS:
        function, *only = name.split()
        names = only or inspect.signature(getattr(gppcs, function)).parameters
        yield from ((name, argument) for argument in names if argument != "workers")  # which would look for a scheduler


@pytest.mark.parametrize(("name", "argument"), [*arguments()])
def test_arguments_of_wrong_types_give_our_errors(name, argument, tmp_path, monkeypatch):
    """A value that is fine after all gives a result; all else is one line that says what was found."""
    monkeypatch.chdir(tmp_path)
    gppcs.write("there.ply", CLOUD)
    (tmp_path / "mesh.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    function, usual = getattr(gppcs, name.split()[0]), CALLS[name]
    if name == "evaluate_mesh":
        pytest.importorskip("pymeshlab")
    function(**usual)
    refused = []
    for value in WRONG:
        try:
            function(**{**usual, argument: value})
        except OURS as error:
            refused.append(str(error))
        except OSError:  # the name of a file that is not there
            assert argument in ("path", "cloud", "original", "simplified")
        except Exception as error:
            raise AssertionError(f"{name}({argument}={value!r}) raised {error!r}") from error
    assert len(refused) > len(WRONG) / 2
    for text in refused:
        assert "expected" in text or "there is no method" in text
        assert "\n" not in text
