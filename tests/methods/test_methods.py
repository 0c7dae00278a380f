"""The methods' parameters: what they may be, and how they are read from text."""

import math

import numpy as np
import pytest

import gppcs
from gppcs.amounts.options import method_of
from gppcs.methods.parameters import parameters_of, with_settings

CLOUD = gppcs.sample("bracket", 600).points


@pytest.mark.parametrize("method", gppcs.METHODS.built_in.values())
def test_each_method_says_what_it_is_and_can_be_called_alone(method):
    assert gppcs.METHODS[method.name] is method
    assert method.summary
    assert method.description.endswith(".")
    assert all(each.meaning.endswith(".") for each in parameters_of(method).values())
    selection = method()(gppcs.Task(CLOUD, 60))
    assert selection.indices.dtype == np.int64
    assert len(set(selection.indices.tolist())) == len(selection.indices) == 60


def beyond(method):
    """Of each parameter with a range, values just outside it."""
    for name, field in method.__dataclass_fields__.items():
        for limit, aside in zip(field.metadata.get("range", ()), (-1, 1), strict=False):
            if limit is not None and math.isfinite(limit):
                whole = parameters_of(method)[name].kind.startswith("int")
                yield name, limit + aside if whole else limit + aside * 1e-6 * max(limit, 1e-6)


@pytest.mark.parametrize("method", gppcs.METHODS.built_in.values())
def test_a_parameter_out_of_range_is_named(method):
    wrong = list(beyond(method))
    if method is gppcs.SpectralGP:
        assert len(wrong) >= 9
        wrong += [("nu", math.nan), ("landmarks", 19)]
    for name, value in wrong:
        with pytest.raises(gppcs.ParameterError, match=f"method '{method.name}': expected {name} to be .*, found"):
            method(**{name: value})
    with pytest.raises(gppcs.ParameterError, match="finite where it is to be fitted, found inf"):
        gppcs.SpectralGP(nu=math.inf, fit_nu=True)


@pytest.mark.parametrize("method", gppcs.METHODS.built_in.values())
def test_a_parameter_of_another_type_is_named(method):
    wrong = {int: ("x", 1.0, True, [1]), float: ("x", False), bool: ("x", 1, None), str: ("x", 1, None)}
    for name, parameter in parameters_of(method).items():
        kind = int if parameter.default is None else type(parameter.default)
        for value in wrong[kind]:
            with pytest.raises(gppcs.ParameterError, match=f"method '{method.name}': expected {name} to be .*, found"):
                method(**{name: value})


@pytest.mark.parametrize(
    ("parameter", "kind", "values", "others"),
    [
        ("neighbours", "int", {"12": 12}, ("many", "2.5", "none", "")),
        ("nu", "float", {"1.5": 1.5, "3": 3.0, "inf": math.inf, "1e2": 100.0}, ("smooth",)),
        ("fit_nu", "bool", {"true": True, "False": False}, ("1",)),
        ("k_init", "int or none", {"7": 7, "none": None, "None": None}, ("third",)),
    ],
)
def test_text_is_read_as_the_type_of_the_parameter_or_refused(parameter, kind, values, others):
    for text, value in values.items():
        read = getattr(with_settings(gppcs.SpectralGP(), {parameter: text}), parameter)
        assert (read, type(read)) == (value, type(value))
    for text in others:
        with pytest.raises(gppcs.ParameterError, match=f"expected {parameter} to be {kind}, found '{text}'"):
            with_settings(gppcs.SpectralGP(), {parameter: text})


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("gp-spektral", {}, "no method 'gp-spektral'; did you mean 'gp-spectral'"),
        ("xyz", {}, "no method 'xyz'; expected one of gp, gp-spectral, fps-variation, top-variation, fps, random"),
        ("gp-spectral", {"neighbors": 5}, "no parameter 'neighbors'; did you mean 'neighbours'"),
        ("random", {"neighbours": 5}, "no parameter 'neighbours'; expected one of seed"),
        ("fps", {"seed": 5}, "no parameter 'seed'; it has none at all"),
    ],
)
def test_unknown_names_come_with_the_nearest(name, settings, message):
    with pytest.raises(gppcs.ParameterError, match=message):
        method_of(name, settings=settings)


SPECTRAL = {"neighbours": 10, "eigenfunctions": 5, "nu": math.inf, "fit_nu": True, "k_opt": 50, "k_init": 5}
CHANGES = {
    "gp": {"feature_weight": 0.6, "lengthscale": 2.5, "neighbours": 8, "candidates": 20.0},
    "gp-spectral": SPECTRAL | {"k_add": 30, "landmarks": 200, "candidates": 100},
    "fps-variation": {"k_init": 5, "neighbours": 10, "candidates": 100},
    "top-variation": {"neighbours": 10},
    "random": {"seed": 1},
    "pc-simp": {"neighbours": 8, "uniformity": 1.0, "tolerance": 0.5, "iterations": 3},
    "qem": {"neighbours": 5},
}


@pytest.mark.parametrize("name", CHANGES)
def test_every_parameter_changes_the_choice(name):
    default = gppcs.simplify(CLOUD, n_points=60, method=name).indices.tolist()
    for parameter, value in CHANGES[name].items():
        changed = gppcs.simplify(
            CLOUD, n_points=60, method=method_of(name, settings={parameter: value})
        ).indices.tolist()
        assert len(set(changed)) == 60
        assert changed != default, parameter


@pytest.mark.parametrize(
    ("staying", "moving"),
    [(gppcs.WLOP(), gppcs.WLOP(snap=False)), (gppcs.Voxel(), gppcs.Voxel(keep="mean"))],
    ids=["wlop", "voxel"],
)
def test_points_that_move_keep_their_attributes(staying, moving, sphere):
    """They stay within about their spacing, and take the type of the coordinates unless those are whole numbers."""
    points = np.concatenate([sphere[:5_000], sphere[:3]]) * 5 + [70, -30, 1000]
    cloud = gppcs.PointCloud(points, {"row": np.arange(len(points))}, np.dtype(np.float32))
    original, moved = (gppcs.simplify(cloud, n_points=300, method=method) for method in (staying, moving))
    np.testing.assert_array_equal(original.cloud.points, points[original.indices])
    np.testing.assert_array_equal(moved.indices, original.indices)
    np.testing.assert_array_equal(moved.cloud.attributes["row"], moved.indices)
    assert moved.cloud.coordinate_dtype == np.float32
    away = np.linalg.norm(moved.cloud.points - original.cloud.points, axis=1)
    assert np.median(away) > 0.1
    assert away.max() < 1.5
    whole_numbers = gppcs.PointCloud(np.rint(points * 100), coordinate_dtype=np.dtype(np.int32))
    assert gppcs.simplify(whole_numbers, n_points=300, method=moving).cloud.coordinate_dtype == np.float64
