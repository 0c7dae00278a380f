import dataclasses
import io
import sys

import numpy as np
import pytest

from gppcs.clouds.mesh import Mesh
from gppcs.drawing import side_by_side
from gppcs.drawing.camera import Camera
from gppcs.drawing.side_by_side import (
    BAR,
    BETWEEN,
    CLOSE_UP_SHARE,
    FLATTEST,
    FRAMES,
    GAP,
    TALLEST,
    TEXT,
    TITLE,
    Column,
    draw_comparison,
)
from gppcs.errors import InputError, MissingExtraError, ParameterError

BUMP = np.array([0.6, -0.64, 0.48])
TRIANGLE = Mesh(np.array([[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [0.0, 0.0, 1.0]]), np.array([[0, 1, 2]]))
WIDTH = 160
TOP = 3 * TITLE
CLOSE_UP = (WIDTH - BETWEEN) // 2


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Make pictures small, to make them fast."""
    monkeypatch.setattr(side_by_side, "MAX_COLUMN_WIDTH", WIDTH)


@pytest.fixture(scope="module")
def original(sphere):
    points = sphere[:3000]
    bump = np.exp(-30.0 * ((points - BUMP) ** 2).sum(axis=1))
    return Column("original", points, 0.01 + 0.2 * bump, "", None)


@pytest.fixture(scope="module")
def camera(original):
    return Camera.towards(original.points, WIDTH, (int(FLATTEST * WIDTH), int(TALLEST * WIDTH)))


@pytest.fixture(scope="module")
def kept(original):
    return Column("some", original.points[:200], original.surface_variation[:200], "H mean 1\nH max 2", None)


def picture(columns):
    """Return a picture, (height, width, 3), 0 to 1."""
    from matplotlib.image import imread

    file = io.BytesIO()
    draw_comparison(file, columns)
    assert file.getvalue().startswith(b"\x89PNG")
    file.seek(0)
    return imread(file, format="png")[..., :3]


@pytest.mark.slow
@pytest.mark.parametrize(("count", "rows", "per_row"), [(1, 1, 1), (6, 1, 6), (7, 2, 4), (13, 3, 5)])
def test_columns_stand_in_rows_of_six_at_most(original, camera, kept, count, rows, per_row):
    image = picture([original, *[kept] * (count - 1)])
    lines = 1 if count == 1 else 2
    height = TOP + camera.size[1] + CLOSE_UP + 3 * BETWEEN + round(1.35 * TEXT * lines) + GAP
    assert image.shape == (rows * height + BAR, per_row * (WIDTH + GAP) + GAP, 3)
    drawn = image.min(axis=2) < 0.9
    for number in range(count):
        row, place = divmod(number, per_row)
        panel = drawn[row * height + TOP :, GAP + place * (WIDTH + GAP) :][: camera.size[1], :WIDTH]
        assert 0.1 < panel.mean() < 0.9


def test_no_picture_is_wider_than_the_width_allowed(monkeypatch, original, kept):
    monkeypatch.setattr(side_by_side, "MAX_WIDTH", 500)
    assert 450 < picture([original, *[kept] * 5]).shape[1] <= 500


def test_the_roughest_place_is_framed_and_enlarged(original, camera):
    from matplotlib.colors import to_rgb

    place, _ = camera.pixels(BUMP[None])
    column, row = place[0] / 2.0 + (GAP, TOP)
    rows, columns = np.nonzero(np.abs(picture([original]) - to_rgb(FRAMES[0])).max(axis=2) < 0.01)
    marked = rows < TOP + camera.size[1]
    side = CLOSE_UP_SHARE * max(camera.size)
    assert (rows[marked].min() + rows[marked].max()) / 2 == pytest.approx(row, abs=0.3 * side)
    assert (columns[marked].min() + columns[marked].max()) / 2 == pytest.approx(column, abs=0.3 * side)
    assert np.ptp(rows[marked]) == pytest.approx(side, abs=3)
    assert np.ptp(rows[~marked]) == pytest.approx(CLOSE_UP, abs=3)
    assert np.ptp(columns[~marked]) == pytest.approx(CLOSE_UP, abs=3)


@pytest.mark.slow
@pytest.mark.usefixtures("opengl")
def test_the_same_input_gives_the_same_pixels(original, kept):
    columns = [original, dataclasses.replace(kept, mesh=TRIANGLE)]
    assert (picture(columns) == picture(columns)).all()


@pytest.mark.usefixtures("opengl")
def test_meshes_stand_under_their_clouds(original, camera, kept):
    image = picture([original, kept, dataclasses.replace(kept, mesh=TRIANGLE)])
    row = TOP + camera.size[1] + CLOSE_UP + 3 * BETWEEN
    drawn = image[row:][: camera.size[1]].min(axis=2) < 0.95
    shares = [drawn[:, GAP + number * (WIDTH + GAP) :][:, :WIDTH].mean() for number in range(3)]
    assert 0.0 < shares[0] == shares[1] < 0.05  # "no mesh"
    assert shares[2] > 0.15


def test_without_meshes_pyvista_is_not_needed(monkeypatch, original, kept):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    picture([original, kept])
    with pytest.raises(MissingExtraError, match=r"the extra view\): pip install .*pyvista"):
        picture([original, dataclasses.replace(kept, mesh=TRIANGLE)])


def test_a_long_title_stays_in_its_column(original, camera):
    image = picture([dataclasses.replace(original, title="sample-elimination " * 3)])
    drawn = image[:TOP].min(axis=2) < 0.9
    assert drawn.any()
    assert not drawn[:, :GAP].any()
    assert not drawn[:, -GAP:].any()


def test_what_cannot_be_drawn_is_refused(original):
    with pytest.raises(ParameterError, match="at least one column"):
        picture([])
    with pytest.raises(InputError, match="one value for each of 3000 points"):
        picture([dataclasses.replace(original, surface_variation=np.zeros(2))])
