import io
import sys

import numpy as np
import pytest

from gppcs.drawing.cloud_images import ColouredCloud
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


def test_the_original_sets_the_colours(ball):
    pictures = []
    for factor in (1.0, 1000.0):
        file = io.BytesIO()
        draw_pair(file, "few", ball, ColouredCloud(ball.points[:50], 1.0 + factor * ball.values[:50]))
        pictures.append(panels(file))
    assert (pictures[0][0] == pictures[1][0]).all()


def test_without_matplotlib_the_extra_is_named(monkeypatch, ball):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r"the extra picture\): pip install .matplotlib"):
        draw_pair(io.BytesIO(), "all", ball, ball)
