"""Points of COLMAP: files written by hand after its documentation, round trips, and damage."""

import struct

import numpy as np
import pytest

import gppcs
from formats import load, losses

IDS, PLACES = [63390, 7], [[1.67241, 0.292931, 0.609726], [-0.5, 1e-9, 4.0]]
COLOURS, ERRORS = [[115, 121, 122], [0, 255, 3]], [1.33927, -1.0]
TRACKS = [[(16, 6542), (15, 7345)], []]
TEXT = """# 3D point list with one line of data per point:
#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)
# Number of points: 2, mean track length: 1
63390 1.67241 0.292931 0.609726 115 121 122 1.33927 16 6542 15 7345
7 -0.5 1e-09 4.0 0 255 3 -1
"""


def binary():
    """Return the same points as COLMAP writes them: little-endian, without gaps."""
    parts = [struct.pack("<Q", 2)]
    for number, place, colour, error, track in zip(IDS, PLACES, COLOURS, ERRORS, TRACKS, strict=True):
        parts.append(struct.pack("<Q3d3BdQ", number, *place, *colour, error, len(track)))
        parts += [struct.pack("<II", *seen) for seen in track]
    return b"".join(parts)


@pytest.mark.parametrize(("name", "content"), [("points3D.txt", TEXT.encode()), ("points3D.bin", binary())])
def test_points_have_numbers_colours_errors_and_lengths_of_tracks(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    cloud = gppcs.read(tmp_path / name)
    assert cloud.points.tolist() == PLACES
    assert cloud.attributes["point3D_id"].tolist() == IDS
    assert np.stack([cloud.attributes[each] for each in ("red", "green", "blue")], axis=1).tolist() == COLOURS
    assert cloud.attributes["error"].tolist() == ERRORS
    seen = gppcs.open(tmp_path / name, only="track_length >= 2").read()
    assert seen.attributes["track_length"].tolist() == [2]
    assert losses(f"other.{name}", seen) == ["the tracks of the points, so that COLMAP's images no longer fit"]
    gppcs.write(tmp_path / f"other.{name}", seen)
    assert "track_length" not in gppcs.read(tmp_path / f"other.{name}").attributes


def test_points_under_another_name_are_recognised_or_the_format_is_named(tmp_path):
    path, rows = tmp_path / "seeds.txt", TEXT.splitlines(keepends=True)[3:]
    path.write_text("".join(rows))
    with pytest.raises(gppcs.errors.FileFormatError, match=r"point 2: .*COLMAP.*format='points3d.txt'"):
        gppcs.read(path)
    assert gppcs.read(path, format="points3d.txt").points.tolist() == PLACES
    path.write_text(rows[0])
    assert any("format='points3d.txt'" in text for text in load(path).unread)


def test_points_without_colours_are_black_and_numbered(tmp_path):
    gppcs.write(tmp_path / "points3D.bin", gppcs.PointCloud(np.eye(3)))
    expected = b"".join(struct.pack("<Q3d3BdQ", 1 + i, *np.eye(3)[i], 0, 0, 0, -1.0, 0) for i in range(3))
    assert (tmp_path / "points3D.bin").read_bytes() == struct.pack("<Q", 3) + expected


def test_what_colmap_cannot_hold_is_told(tmp_path):
    cloud = gppcs.PointCloud(np.eye(3), {"depth": np.ones(3), "point3D_id": np.zeros(3, np.int64)})
    with pytest.raises(gppcs.errors.OutputError, match=r"depth .*point3D_id"):
        gppcs.write(tmp_path / "points3D.bin", cloud)
    assert not (tmp_path / "points3D.bin").exists()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("points3D.bin", b"\x01\x00", "expected 1 points of COLMAP to fill the file of 2 bytes"),
        ("points3D.bin", binary()[:-9], "expected 2 points of COLMAP to fill the file"),
        ("points3D.bin", binary() + b"x", "expected 2 points of COLMAP to fill the file"),
        ("points3D.txt", TEXT.replace(" 115 ", " red ").encode(), "point 1: expected a number, found 'red'"),
        ("points3D.txt", TEXT.replace(" 115 ", " 1.5 ").encode(), "expected 0 to 255 as red of point 1, found '1.5'"),
        ("points3D.txt", TEXT.replace(" 115 ", " 300 ").encode(), "expected 0 to 255 as red of point 1, found '300"),
    ],
)
def test_damage_is_told(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(gppcs.errors.FileFormatError, match=message):
        gppcs.read(tmp_path / name)
