import io
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.drawing.camera import Camera
from gppcs.drawing.cloud_images import ColouredCloud
from gppcs.drawing.side_by_side import BETWEEN, GAP, TITLE, Column, draw_comparison, feature_squares
from gppcs.drawing.web.layers import Named

matplotlib = pytest.importorskip("matplotlib")
BUMP = np.array([0.6, -0.64, 0.48])
TRIANGLE = Mesh(np.array([[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [0.0, 0.0, 1.0]]), np.array([[0, 1, 2]]))
WIDTH = 560  # of a column with close-ups
TOP = 3 * TITLE
CLOSE_UP = (WIDTH - BETWEEN) // 2


@pytest.fixture(scope="module")
def original(sphere):
    points = sphere[:3000]
    bump = np.exp(-30.0 * ((points - BUMP) ** 2).sum(axis=1))
    return Column(Named("original", PointCloud(points)), ColouredCloud(points, 0.01 + 0.2 * bump))


@pytest.fixture(scope="module")
def camera(original):
    return Camera.towards(original.cloud.points, WIDTH, (int(0.6 * WIDTH), int(1.3 * WIDTH)))


@pytest.fixture(scope="module")
def kept(original):
    kept = original.named.cloud.points[:200]
    return Column(Named("kept", PointCloud(kept)), original.cloud.at(kept), "H mean 1\nH max 2")


def picture(*columns, **options):
    """Return a picture, (height, width, 3), 0 to 1."""
    file = io.BytesIO()
    draw_comparison(file, columns, **options)
    assert file.getvalue().startswith(b"\x89PNG")
    file.seek(0)
    return matplotlib.image.imread(file)[..., :3]


def test_the_roughest_place_is_framed_and_enlarged(original, camera):
    pixels, _ = camera.pixels(BUMP[None])
    column, row = pixels[0] / 2.0 + (GAP, TOP)
    red = matplotlib.colors.to_rgb("#d1495b")
    rows, columns = np.nonzero(np.abs(picture(original) - red).max(axis=2) < 0.01)
    marked = rows < TOP + camera.size[1]
    side = 0.18 * max(camera.size)
    assert (rows[marked].min() + rows[marked].max()) / 2 == pytest.approx(row, abs=0.3 * side)
    assert (columns[marked].min() + columns[marked].max()) / 2 == pytest.approx(column, abs=0.3 * side)
    assert np.ptp(rows[marked]) == pytest.approx(side, abs=3)
    assert [np.ptp(pixels[~marked]) for pixels in (rows, columns)] == pytest.approx([CLOSE_UP, CLOSE_UP], abs=3)


def test_meshes_stand_under_their_clouds(original, camera, kept):
    image = picture(original, kept, replace(kept, named=replace(kept.named, mesh=TRIANGLE)))
    row = TOP + camera.size[1] + CLOSE_UP + 3 * BETWEEN
    drawn = image[row:][: camera.size[1]].min(axis=2) < 0.95
    covered = [drawn[:, GAP + number * (WIDTH + GAP) :][:, :WIDTH].mean() for number in range(3)]
    assert 0.0 < covered[0] == covered[1] < 0.05  # "no mesh"
    assert covered[2] > 0.15


@given(arrays(np.float64, (15, 20), elements=st.floats(0.0, 1.0, width=16)), st.integers(1, 6))
def test_the_first_square_is_the_best_of_all_and_squares_keep_apart(picture, side):
    def total(column, row):
        return picture[row : row + side, column : column + side].sum()

    squares = feature_squares(picture, side, 3)
    best = max(total(column, row) for row in range(16 - side) for column in range(21 - side))
    assert bool(squares) == (best > 0.0)
    assert [total(column, row) for column, row, _ in squares[:1]] == pytest.approx([best] * len(squares[:1]))
    for rank, one in enumerate(squares):
        assert one[0] + side <= 20
        assert one[1] + side <= 15
        for other in squares[:rank]:
            assert max(abs(one[0] - other[0]), abs(one[1] - other[1])) >= 1.5 * side
