import io
from dataclasses import replace

import numpy as np
import pytest

from gppcs.drawing.cloud_images import ColouredCloud
from gppcs.drawing.colours import Legend
from gppcs.drawing.pair import ABOVE, BELOW, draw_pair

image = pytest.importorskip("matplotlib.image")


@pytest.fixture
def ball(sphere):
    return ColouredCloud(sphere[:5000], np.linspace(0.0, 1.0, 5000))


def panels(original, simplified, legend=None):
    """Return the two panels of a picture, 0 to 1, and what is below them."""
    file = io.BytesIO()
    draw_pair(file, "few", original, simplified, legend=legend)
    assert file.getvalue().startswith(b"\x89PNG")
    file.seek(0)
    drawn = image.imread(file)[..., :3]
    assert drawn.shape == (800, 1600, 3)
    return *np.split(drawn[ABOVE:-BELOW], 2, axis=1), drawn[-BELOW:]


def test_both_clouds_are_seen_alike(ball):
    boxes = []
    for panel in panels(ball, ball)[:2]:
        rows, columns = np.nonzero(panel.min(axis=2) < 0.9)
        boxes.append((rows.min(), rows.max(), columns.min(), columns.max()))
    assert boxes[0][1] - boxes[0][0] > 550
    np.testing.assert_allclose(boxes[0], boxes[1], atol=10)


def test_colours_of_the_clouds_are_drawn_with_their_legend(ball):
    original = replace(ball, colours=np.broadcast_to((1.0, 0.1, 0.1), ball.points.shape))
    whole, few, bar = panels(original, original.at(ball.points[:50]), Legend("RGB"))
    middle = whole[len(whole) // 2, whole.shape[1] // 2]
    np.testing.assert_allclose(middle / middle.max(), (1.0, 0.1, 0.1), atol=0.02)
    coloured = few[np.ptp(few, axis=2) > 0.3]
    assert len(coloured) > 50
    assert (coloured.argmax(axis=1) == 0).all()
    assert (bar == 1.0).all()  # RGB has no colour bar
