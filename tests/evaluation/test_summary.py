"""The facts of a cloud."""

import io

import numpy as np
import pytest

import gppcs
from gppcs.evaluation.summary import Summary


def test_facts_of_a_grid():
    grid = np.stack(np.meshgrid([0.0, 2.0, 4.0], [0.0, 2.0], [0.0, 2.0]), axis=-1).reshape(-1, 3)
    points = np.concatenate([grid + 10, grid[:3] + 10, [[np.nan, 0, 0], [0, np.inf, 0]]])
    cloud = gppcs.PointCloud(
        points,
        {"label": np.arange(17, dtype=np.uint8), "normal": np.tile(np.float32([-1, 0, np.inf]), (17, 1))},
        np.dtype(np.float32),
    )
    assert gppcs.info(cloud) == Summary(
        points=17,
        minimum=(10.0, 10.0, 10.0),
        maximum=(14.0, 12.0, 12.0),
        diagonal=pytest.approx(np.sqrt(24)),
        spacing=pytest.approx(2.0),
        repeats=3,
        non_finite=2,
        coordinate_type="float32",
        attributes={"label": "uint8", "normal": "float32 x 3"},
        ranges={"label": (0, 16), "normal": (-1.0, 0.0)},
    )


@pytest.mark.parametrize("points", [np.empty((0, 3)), np.full((2, 3), np.nan)])
def test_without_finite_points_lengths_are_nan(points):
    summary = gppcs.info(points)
    assert (summary.points, summary.repeats, summary.non_finite) == (len(points), 0, len(points))
    assert np.isnan([*summary.minimum, *summary.maximum, summary.diagonal, summary.spacing]).all()


@pytest.mark.parametrize("unit", [1e-310, 1e-200, 1e200, 1e307])
def test_lengths_are_right_in_any_unit(unit):
    points = np.array([[0, 0, 0], [3, 0, 0], [3, 4, 0], [3, 4, 0]]) * unit
    summary = gppcs.info(points)
    assert summary.diagonal == pytest.approx(5 * unit, rel=1e-9)
    assert summary.spacing == pytest.approx(3 * unit, rel=1e-9)
    assert (summary.maximum, summary.repeats) == ((3 * unit, 4 * unit, 0.0), 1)


def test_spacing_does_not_depend_on_where_the_cloud_lies(bracket):
    near, far = gppcs.info(bracket), gppcs.info(bracket + np.array([500_000, 5_400_000, 0]))
    assert far.spacing == pytest.approx(near.spacing, rel=1e-6)
    assert near.spacing > 0


def test_files_and_open_files_have_the_facts_of_their_clouds(tmp_path, bracket):
    path, expected = tmp_path / "a.npy", gppcs.info(bracket)
    gppcs.write(path, bracket)
    with path.open("rb") as file:
        assert gppcs.info(file) == gppcs.info(path) == gppcs.info(io.BytesIO(path.read_bytes())) == expected
        assert len(gppcs.simplify(file, n_points=9, method="random")) == 9
