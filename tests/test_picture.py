import io
import sys

import numpy as np
import pytest

from gppcs.errors import InputError, MissingExtraError, ParameterError
from gppcs.picture import Panel, draw, require_matplotlib

SIZE = (800, 400)
TITLES, BAR = 68, 74  # pixels above and below the panels


def pixels(panels, **options):
    """Return the part of the picture with the panels, (height, width, 3), 0 to 1."""
    from matplotlib.image import imread

    file = io.BytesIO()
    draw(file, panels, **{"size": SIZE, **options})
    file.seek(0)
    image = imread(file, format="png")
    assert image.shape[:2] == options.get("size", SIZE)[::-1]
    return image[TITLES:-BAR, :, :3]


def halves(image):
    return np.split(image, 2, axis=1)


def ellipsoid(count=20_000, seed=0):
    """Return points of an ellipsoid that is seen from -y, and its normals."""
    direction = np.random.default_rng(seed).standard_normal((count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    semi_axes = np.array([2.0, 1.0, 1.5])
    normals = direction / semi_axes
    return direction * semi_axes, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def test_a_picture_is_a_png_of_its_size(tmp_path):
    points, _ = ellipsoid(500)
    target = tmp_path / "picture.png"
    draw(target, [Panel("original", points, points[:, 2]), Panel("some", points[:50], points[:50, 2])])
    content = target.read_bytes()
    assert content.startswith(b"\x89PNG")
    assert (int.from_bytes(content[16:20]), int.from_bytes(content[20:24])) == (1600, 800)


@pytest.mark.parametrize("given_normals", [True, False])
@pytest.mark.parametrize("view", [(0.0, 0.0), (25.0, 20.0)])
def test_the_far_side_does_not_show_through(given_normals, view):
    points, normals = ellipsoid()
    azimuth, elevation = np.radians(view)
    to_viewer = [np.cos(elevation) * np.sin(azimuth), -np.cos(elevation) * np.cos(azimuth), np.sin(elevation)]
    far = (normals @ to_viewer < -0.25).astype(float)  # drawn yellow, the near side blue
    some = slice(0, 3000)
    panels = [
        Panel("original", points, far, normals if given_normals else None),
        Panel("some", points[some], far[some], normals[some] if given_normals else None),
    ]
    for image in halves(pixels(panels, view=view)):
        red, blue = image[..., 0], image[..., 2]
        assert (blue > red + 0.1).mean() > 0.05
        assert (red > blue + 0.05).sum() == 0


def test_the_reference_is_closed_and_the_others_are_single_points():
    points, _ = ellipsoid()
    value = np.zeros(len(points))
    original, some = halves(pixels([Panel("original", points, value), Panel("some", points[:300], value[:300])]))
    blue_original, blue_some = (image[..., 2] > image[..., 0] + 0.05 for image in (original, some))
    row = blue_original[len(blue_original) // 2]
    assert row[np.flatnonzero(row)[0] : np.flatnonzero(row)[-1]].all()
    assert 0.02 < blue_some.sum() / blue_original.sum() < 0.5


def test_panels_share_one_camera():
    points, _ = ellipsoid()
    value = np.zeros(len(points))
    images = halves(pixels([Panel("original", points, value), Panel("all", points, value)]))
    boxes = []
    for image in images:
        rows, columns = np.nonzero(image.min(axis=2) < 0.9)
        boxes.append((rows.min(), rows.max(), columns.min(), columns.max()))
    np.testing.assert_allclose(boxes[0], boxes[1], atol=10)


def test_the_scale_ends_at_the_98th_percentile_of_the_original():
    points, _ = ellipsoid()
    near = points[:, 1] < 0.0
    values = np.where(near, 1.0, 0.0)
    wild = values.copy()
    wild[:20] = 1e6
    calm, spoilt = (pixels([Panel("original", points, v)], view=(0.0, 0.0)) for v in (values, wild))
    assert np.mean(np.abs(calm - spoilt) > 0.01) < 0.01


def test_a_value_that_is_not_a_number_is_grey():
    points, _ = ellipsoid()
    image = pixels([Panel("original", points, np.full(len(points), np.nan))])
    assert np.ptp(image, axis=2).max() < 0.01
    assert image.min() < 0.7


@pytest.mark.parametrize(
    "points",
    [
        np.array([[1.0, 2.0, 3.0]]),
        np.zeros((20, 3)),
        np.linspace([0.0, 0.0, 0.0], [1.0, 2.0, 3.0], 50),
        np.linspace([0.0, 5.0, 0.0], [0.0, 9.0, 0.0], 50),
        np.array([[x, y, 0.0] for x in range(20) for y in range(20)], dtype=float),
        1e7 + np.array([[x, 0.0, z] for x in range(9) for z in range(9)]) * 1e-3,
        np.array([[0.0, 0.0, 0.0], [1e-300, 0.0, 0.0]]),
        np.array([[0.0, 0.0, 0.0], [1e150, 0.0, 1.0]]),
    ],
    ids=["one point", "one place", "slanted line", "line", "plane", "far away", "tiny", "huge"],
)
def test_clouds_without_extent_are_drawn(points):
    values = np.arange(len(points), dtype=float)
    images = halves(pixels([Panel("original", points, values), Panel("some", points[:1], values[:1])]))
    assert all((image < 0.9).any() for image in images)


def test_a_stray_does_not_make_the_rest_tiny():
    points, _ = ellipsoid()
    points[0] = [1e9, 0.0, 0.0]
    covered = pixels([Panel("original", points, np.zeros(len(points)))]).min(axis=2) < 0.9
    assert covered.mean() > 0.1


def test_flat_things_are_seen_from_above_and_tall_ones_stand():
    rng = np.random.default_rng(0)
    box = rng.uniform(-1.0, 1.0, (4000, 3))
    for extents, colour_by in (((2.0, 2.0, 0.1), 1), ((2.0, 1.0, 2.5), 2), ((2.0, 2.5, 1.5), 1)):
        points = box * extents
        image = pixels([Panel("original", points, (points[:, colour_by] > 0.0).astype(float))], size=(300, 400))
        red = np.argwhere(image[..., 0] > image[..., 2] + 0.1)
        blue = np.argwhere(image[..., 2] > image[..., 0] + 0.1)
        assert red[:, 0].mean() < blue[:, 0].mean()  # the high half is up in the picture


def test_without_matplotlib_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r"needs matplotlib: pip install 'gppcs\[picture\]'"):
        require_matplotlib()
    points, _ = ellipsoid(10)
    with pytest.raises(MissingExtraError):
        draw(io.BytesIO(), [Panel("original", points, points[:, 0])])


@pytest.mark.parametrize(
    ("panel", "message"),
    [
        ((np.zeros((3, 2)), np.zeros(3)), r"shape \(N, 3\) with N >= 1 to draw, found \(3, 2\)"),
        ((np.zeros((0, 3)), np.zeros(0)), r"found \(0, 3\)"),
        ((np.zeros((3, 3)), np.zeros(2)), r"one value for each of 3 points, found shape \(2,\)"),
        ((np.full((3, 3), np.nan), np.zeros(3)), "found NaN or infinity"),
        ((np.zeros((3, 3)), np.zeros(3), np.zeros((2, 3))), r"normals of shape \(3, 3\), found \(2, 3\)"),
    ],
)
def test_panels_that_do_not_fit_are_refused(panel, message):
    with pytest.raises(InputError, match=message):
        Panel("original", *panel)


@pytest.mark.parametrize(
    ("panels", "options", "message"),
    [
        (0, {}, "at least one panel"),
        (1, {"view": (0.0, 91.0)}, "elevation from -90 to 90"),
        (1, {"view": (float("nan"), 0.0)}, "found"),
        (5, {"size": (300, 300)}, "make it larger"),
    ],
)
def test_pictures_that_cannot_be_are_refused(panels, options, message):
    points, _ = ellipsoid(10)
    with pytest.raises(ParameterError, match=message):
        draw(io.BytesIO(), [Panel("original", points, points[:, 0])] * panels, **options)
