import dataclasses
import io
import sys

import numpy as np
import pytest

from gppcs.drawing.cloud_images import ColouredCloud
from gppcs.drawing.paint import Legend
from gppcs.drawing.pair import ABOVE, BELOW, draw_pair
from gppcs.errors import MissingExtraError


@pytest.fixture
def ball(sphere):
    points = sphere[:5000]
    return ColouredCloud(points, np.linspace(0.0, 1.0, 5000))


def panels(file):
    """Return the two panels of a picture, 0 to 1."""
    from matplotlib.image import imread

    file.seek(0)
    image = imread(file, format="png")
    assert image.shape[:2] == (800, 1600)
    return np.split(image[ABOVE:-BELOW, :, :3], 2, axis=1)


def test_a_picture_is_a_png_of_two_clouds_seen_alike(ball):
    file = io.BytesIO()
    draw_pair(file, "all", ball, ball)
    assert file.getvalue().startswith(b"\x89PNG")
    boxes = []
    for image in panels(file):
        rows, columns = np.nonzero(image.min(axis=2) < 0.9)
        boxes.append((rows.min(), rows.max(), columns.min(), columns.max()))
    assert boxes[0][1] - boxes[0][0] > 550
    np.testing.assert_allclose(boxes[0], boxes[1], atol=10)


@pytest.mark.slow
def test_the_original_sets_the_colours(ball):
    pictures = []
    for factor in (1.0, 1000.0):
        file = io.BytesIO()
        draw_pair(file, "few", ball, ColouredCloud(ball.points[:50], 1.0 + factor * ball.values[:50]))
        pictures.append(panels(file))
    assert (pictures[0][0] == pictures[1][0]).all()


def test_colours_of_the_clouds_are_drawn_with_their_legend(ball):
    from matplotlib.image import imread

    red = np.broadcast_to((1.0, 0.1, 0.1), ball.points.shape)
    original = dataclasses.replace(ball, colours=red)
    file = io.BytesIO()
    draw_pair(file, "few", original, original.kept(np.arange(50), ball.points[:50]), legend=Legend("RGB"))
    whole, few = panels(file)
    middle = whole[len(whole) // 2, whole.shape[1] // 2]
    np.testing.assert_allclose(middle / middle.max(), red[0], atol=0.02)
    coloured = few[np.ptp(few, axis=2) > 0.3]
    assert len(coloured) > 50
    assert (coloured.argmax(axis=1) == 0).all()
    file.seek(0)
    assert (imread(file, format="png")[-BELOW:] == 1.0).all()  # RGB has no colour bar


def test_without_matplotlib_the_extra_is_named(monkeypatch, ball):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r"the extra picture\): pip install .matplotlib"):
        draw_pair(io.BytesIO(), "all", ball, ball)
