"""Files in, files out."""

import numpy as np
import pytest

import gppcs
from gppcs.errors import OutputError
from gppcs.streaming.folder import Target


@pytest.mark.parametrize("memory", ["1GB", None])
def test_a_run_that_was_stopped_goes_on_to_the_points_of_one_cloud(tmp_path, monkeypatch, memory):
    if memory:
        monkeypatch.setattr(gppcs.FarthestPoint, "memory", lambda self, n, n_points: 10**12)
        monkeypatch.setattr("gppcs.streaming.beyond_memory.TILE", 2_000)
    cloud = gppcs.sample("bracket", 6_000)
    paths = [tmp_path / "a.ply", tmp_path / "b.ply"]
    for path, rows in zip(paths, (np.arange(2_500), np.arange(2_500, 6_000)), strict=True):
        gppcs.write(path, cloud.take(rows))
    options = {"n_points": 300, "method": "fps", "memory": memory}
    whole = gppcs.simplify(paths, **options)
    with monkeypatch.context() as patch:
        write = Target.write

        def write_one(target, cloud, indices):
            if target.path.name == "b.ply":
                raise KeyboardInterrupt
            return write(target, cloud, indices)

        patch.setattr(Target, "write", write_one)
        with pytest.raises(KeyboardInterrupt):
            gppcs.simplify_tiles(paths, tmp_path / "out", **options)
    with pytest.raises(OutputError, match="force"):
        gppcs.simplify_tiles(paths, tmp_path / "out", **{**options, "n_points": 200})
    written = gppcs.simplify_tiles(paths, tmp_path / "out", **options)
    kept = [gppcs.read(path) for path in written]
    assert [len(part) for part in kept] == [*written.values()]
    assert np.array_equal(np.concatenate([part.points for part in kept]), in_order_of_files(whole, 2_500))
    assert len(gppcs.read(tmp_path / "out" / "index.vpc")) == 300 == len(whole)
    assert not (tmp_path / "out" / ".gppcs").exists()


def in_order_of_files(result, first_of_second):
    """Return the kept points of the first file, then those of the second, each by importance."""
    is_second = result.indices >= first_of_second
    return np.concatenate([result.points[~is_second], result.points[is_second]])
