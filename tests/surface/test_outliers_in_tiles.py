"""Outliers of a cloud on disk: the same as in memory, whatever the chunks and tiles."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gppcs
from gppcs.engine.stages import Stages
from gppcs.spatial import stored
from gppcs.spatial.chunks import ChunkedPoints
from gppcs.spatial.scaling import normalised
from gppcs.surface.outliers import outliers_among, rounds, tiles
from heard import Heard


def in_tiles(points, chunks, *, tile, halo, box, batch=1 << 14, folder=None, heard=None):
    """The mask of the outliers of points that are given in chunks."""
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory() as temporary:
        for module, name, value in ((tiles, "TILE", tile), (tiles, "HALO", halo), (stored, "BOX", box)):
            patch.setattr(module, name, value)
        patch.setattr(rounds, "BATCH", batch)
        chunked = ChunkedPoints(len(points), lambda: np.array_split(points, chunks))
        rows = tiles.outliers_in_tiles(
            chunked, points.max(axis=0), Path(folder or temporary), Stages(heard), lambda *of: list(map(*of))
        )
    assert (np.diff(rows) > 0).all()
    mask = np.zeros(len(points), dtype=bool)
    mask[rows] = True
    return mask


@settings(max_examples=10)
@given(
    seed=st.integers(0, 10**6),
    kind=st.sampled_from(["volume", "plane", "grid", "few"]),
    n=st.integers(1, 900),
    strays=st.integers(0, 25),
    chunks=st.integers(1, 6),
    sizes=st.sampled_from([(60, 40, 20), (200, 5, 30), (100, 10**6, 25), (10**6, 10**6, 10**6)]),
    batch=st.sampled_from([7, 1000]),
)
def test_tiles_make_no_difference(seed, kind, n, strays, chunks, sizes, batch):
    """Nor does a halo that is always too small, nor strays that lie far away from all tiles."""
    rng = np.random.default_rng(seed)
    points = rng.random((n, 3)) * [30, 30, 30 * (kind == "volume")]
    points = np.concatenate([points, points[: n // 6], rng.standard_normal((strays, 3)) * [9, 9, 9 + 400 * (n % 2)]])
    points = rng.permutation(np.round(points) if kind == "grid" else points[:: 50 if kind == "few" else 1])
    points = normalised(points)[0]
    tile, halo, box = sizes
    found = in_tiles(points, min(chunks, len(points)), tile=tile, halo=halo, box=box, batch=batch)
    np.testing.assert_array_equal(found, outliers_among(points))


@pytest.mark.parametrize("name", ["bracket", "fan"])
def test_outliers_of_a_scan(name):
    points = normalised(gppcs.sample(name, 12_000, outliers=0.02).points)[0]
    expected = outliers_among(points)
    assert expected.sum() > 50
    np.testing.assert_array_equal(in_tiles(points, 3, tile=2_500, halo=2_500, box=700), expected)


def test_tiles_tell_most_by_themselves(monkeypatch):
    """So what is looked up across all tiles is little."""
    points = normalised(gppcs.sample("bracket", 12_000, outliers=0.01).points)[0]
    judged, plain = [], rounds._judged
    monkeypatch.setattr(rounds, "_judged", lambda *of: judged.append(len(of[1].places)) or plain(*of))
    in_tiles(points, 3, tile=3_000, halo=3_000, box=700)
    assert 0 < judged[0] < 0.1 * len(points)
    assert sum(judged[1:]) < 0.2 * len(points)


def test_what_was_looked_at_is_not_looked_at_again(tmp_path, monkeypatch):
    points = normalised(gppcs.sample("bracket", 3_000, outliers=0.02).points)[0]
    sizes = {"tile": 1_000, "halo": 1_000, "box": 200, "folder": tmp_path}

    def stop(*_):
        raise RuntimeError

    plain = rounds._judged
    stops = iter([plain, stop])  # in the second round
    monkeypatch.setattr(rounds, "_judged", lambda *of: next(stops)(*of))
    with pytest.raises(RuntimeError):
        in_tiles(points, 2, **sizes)
    monkeypatch.setattr(rounds, "_judged", plain)
    heard = Heard()
    expected = outliers_among(points)
    np.testing.assert_array_equal(in_tiles(points, 2, **sizes, heard=heard), expected)
    assert [stage for stage, total, _ in heard.stages if total] == []
