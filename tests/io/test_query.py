"""Which points of a file are read: conditions and polygons, in memory and in chunks."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gppcs
from gppcs.errors import FileFormatError
from gppcs.io.query import Polygons, read_polygons

SQUARE = [[0, 0], [10, 0], [10, 10], [0, 10], [0, 0]]
HOLE = [[4, 4], [6, 4], [6, 6], [4, 6], [4, 4]]
CLOUD = gppcs.PointCloud(
    np.random.default_rng(0).uniform(-5, 15, (3000, 3)).astype(np.float32),
    {"classification": (np.arange(3000) % 9).astype(np.uint8)},
    np.float32,
)


def inside(points):
    x, y = points[:, 0], points[:, 1]
    return (x > 0) & (x < 10) & (y > 0) & (y < 10) & ~((x > 4) & (x < 6) & (y > 4) & (y < 6))


@pytest.fixture
def files(tmp_path):
    """Return a function that writes GeoJSON; the cloud is in the file scan.ply beside it."""
    gppcs.write(tmp_path / "scan.ply", CLOUD)

    def write(content):
        (tmp_path / "area.json").write_text(content if isinstance(content, str) else json.dumps(content))
        return tmp_path / "scan.ply", tmp_path / "area.json"

    return write


@pytest.mark.parametrize(
    "wrapped",
    [
        lambda polygon: polygon,
        lambda polygon: {"type": "Feature", "properties": {}, "geometry": polygon},
        lambda polygon: {"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": polygon}]},
        lambda polygon: {"type": "MultiPolygon", "coordinates": [polygon["coordinates"]]},
        lambda polygon: {"type": "GeometryCollection", "geometries": [polygon, {"type": "Point", "coordinates": [1]}]},
    ],
)
def test_points_inside_a_polygon_with_a_hole(files, wrapped):
    scan, area = files(wrapped({"type": "Polygon", "coordinates": [SQUARE, HOLE]}))
    read = gppcs.open(scan, inside=area).read()
    assert read.points.tolist() == CLOUD.points[inside(CLOUD.points)].tolist()
    both = gppcs.open(scan, inside=[str(area), "0,0,5,5"]).read()
    assert both.points.tolist() == read.points[(read.points[:, :2] <= 5).all(axis=1)].tolist()
    square = gppcs.open(scan, inside=np.array(SQUARE[:4])).read()
    assert len(square) == ((CLOUD.points[:, :2] > 0) & (CLOUD.points[:, :2] < 10)).all(axis=1).sum()


@pytest.mark.parametrize("kind", ["MultiPolygon", "FeatureCollection"])
def test_points_in_two_overlapping_polygons_are_inside(files, kind):
    """Each polygon has a hole, which counts for that polygon only, and an empty one has no effect."""
    polygons = [[SQUARE, HOLE], [[[x - 3, y - 3] for x, y in ring] for ring in (SQUARE, HOLE)], []]
    features = [{"type": "Feature", "geometry": {"type": "Polygon", "coordinates": rings}} for rings in polygons]
    multi = {"type": "MultiPolygon", "coordinates": polygons}
    scan, area = files(multi if kind == "MultiPolygon" else {"type": kind, "features": features})
    expected = inside(CLOUD.points) | inside(CLOUD.points + 3)
    assert gppcs.open(scan, inside=area).read().points.tolist() == CLOUD.points[expected].tolist()


def test_a_polygon_with_many_corners():
    angles = np.linspace(0.0, 2.0 * np.pi, 5_000, endpoint=False)
    disc = Polygons(((tuple(zip(np.cos(angles).tolist(), np.sin(angles).tolist(), strict=True)),),))
    points = np.random.default_rng(0).uniform(-1.2, 1.2, (5_000, 3))
    radii = np.hypot(points[:, 0], points[:, 1])
    sure = np.abs(radii - 1.0) > 1e-5
    assert (disc.contains(points) == (radii < 1.0))[sure].all()


@pytest.mark.parametrize(
    "content",
    ["", "[]", "{}",
     '{"type": "Point", "coordinates": [0, 0]}', '{"type": "Polygon", "coordinates": [[[0, 0], [1, 1]]]}',
     '{"type": "Polygon", "coordinates": [[[0, 0], [1, null], [2, 2]]]}', '{"type": "Polygon", "coordinates": 3}',
     '{"type": "Polygon", "coordinates": [[[0, 0], [1, "1"], [2, 2]]]}',
     f'{{"type": "Polygon", "coordinates": [[[0, 0], [1, {10**400}], [2, 2]]]}}',
     '{"type": "Polygon", "coordinates": [[[0, 0], [1, NaN], [2, 2]]]}', '{"type": "Feature", "geometry": null}'],
)  # fmt: skip
def test_what_is_no_polygon_is_refused(files, content):
    _, area = files(content)
    with pytest.raises(FileFormatError, match=r"area.json: expected .*polygon.* in GeoJSON"):
        read_polygons(area)


@pytest.mark.parametrize("suffix", [".ply", ".las", ".csv", ".npz"])
def test_conditions_choose_points_of_any_format(tmp_path, suffix):
    path = tmp_path / f"scan{suffix}"
    gppcs.write(path, CLOUD, lossy=True)
    whole = gppcs.read(path)
    read = gppcs.open(path, only="classification in [2, 6] and z > 3 and not x > 7", inside=[-5, -5, 15, 12]).read()
    kinds, (x, y, z) = whole.attributes["classification"], whole.points.T
    rows = np.flatnonzero(np.isin(kinds, [2, 6]) & (z > 3) & ~(x > 7) & (y <= 12))
    assert read == whole.take(rows)


def test_beyond_memory_the_same_points_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr(gppcs.LocalGP, "memory", lambda self, n, n_points: 2 * 10**9)
    cloud = gppcs.sample("village", n_points=8_000)
    gppcs.write(tmp_path / "scan.las", cloud, lossy=True)
    source = gppcs.open(tmp_path / "scan.las", only="classification == 2 or z > 0")
    result = gppcs.simplify(source, memory="1GB", n_points=60)
    assert len(result.indices) == 60
    assert result.cloud == source.read().take(result.indices)


def test_an_attribute_that_is_not_there_is_named_with_the_file(files):
    scan, _ = files("{}")
    with pytest.raises(FileFormatError, match=r"scan.ply: .*at character 1 .*'klassification'; did you mean"):
        gppcs.open(scan, only="klassification == 2").read()
    with pytest.raises(gppcs.InputError, match="expected points with z > 99, found none"):
        gppcs.simplify(gppcs.open(scan, only="z > 99"), n_points=5)


@given(st.integers(0, 10**6))
@settings(max_examples=20, deadline=None)
def test_polygons_with_a_common_border_share_its_points_out(seed):
    """Each point near a slanted border, and on it, is in one of two polygons that give it in opposite directions."""
    rng = np.random.default_rng(seed)
    (ax, ay), (bx, by) = rng.random((2, 2)) * [1, 10]
    left = Polygons(((((-9.0, ay), (ax, ay), (bx, by), (-9.0, by)),),))
    right = Polygons(((((9.0, by), (bx, by), (ax, ay), (9.0, ay)),),))
    share = rng.random(999)
    points = np.column_stack([ax + share * (bx - ax), ay + share * (by - ay), np.zeros(999)])
    assert (left.contains(points) ^ right.contains(points)).all()
