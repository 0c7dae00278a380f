"""Virtual point clouds: lists of files."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

import gppcs
from formats import load
from gppcs.engine.timer import Timer
from gppcs.errors import FileFormatError, ParameterError
from gppcs.io import CloudFiles, files_of
from gppcs.streaming import copc


def feature(**assets):
    return {"type": "Feature", "stac_version": "1.0.0", "id": "a", "properties": {"pc:count": 3}, "assets": assets}


def data(name):
    return {"data": {"href": name, "roles": ["data"]}}


def write_vpc(path, *features):
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}), encoding="utf-8")
    return path


def test_the_files_are_listed_in_order(tmp_path):
    overview = {"overview": {"href": "./overview.copc.laz", "roles": ["overview"]}}
    vpc = write_vpc(
        tmp_path / "a.vpc",
        feature(**data("./b ü%20.laz")),
        feature(**overview, **data("deeper/../a.copc.laz")),
        feature(**data("/elsewhere/c.las")),
        feature(**data("file:///elsewhere/d%20e.las")),
        feature(**overview, points={"href": "f.laz", "roles": ["data"]}),
        feature(**data("FILE://localhost/elsewhere/g.las")),
        feature(**data("file:/elsewhere/h.las")),
        feature(**data("HTTPS://a.org/i.laz")),
    )
    names = ["b ü%20.laz", "deeper/../a.copc.laz", "/elsewhere/c.las", "/elsewhere/d e.las", "f.laz"]
    names += ["/elsewhere/g.las", "/elsewhere/h.las"]
    assert files_of(vpc) == [*(tmp_path / name for name in names), Path("HTTPS://a.org/i.laz")]
    os.chdir(tmp_path)
    assert files_of(Path("a.vpc"))[0] == Path("b ü%20.laz")


ELSEWHERE = [
    "file://host/share/a.laz",
    "file:////host/share/a.laz",
    "file:///%5Chost/share/a.laz",
    "//host/share/a.laz",
    r"\\host\share\a.laz",
    "file://[/a.laz",
    "file:///a%00.laz",
]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "a virtual point cloud in GeoJSON, but Expecting value"),
        ("\xff", "a virtual point cloud in GeoJSON, but"),
        ("[" * 100_000, "a virtual point cloud in GeoJSON, but"),
        ("[]", "with features, one for each file, found none"),
        ('{"features": []}', "with features, one for each file, found none"),
        ('{"features": {}}', "with features, one for each file, found none"),
        ('{"features": [7]}', "as asset 'data' of feature 1, found none"),
        (json.dumps({"features": [feature(**data("a.laz")), feature()]}), "as asset 'data' of feature 2, found none"),
        (json.dumps({"features": [feature(**data(7))]}), "as asset 'data' of feature 1, found none"),
        (json.dumps({"features": [feature(data=[])]}), "as asset 'data' of feature 1, found none"),
        (json.dumps({"features": [feature(**data("file://a.org/a.laz"))]}), "found 'file://a.org/a.laz'; get them"),
        *((json.dumps({"features": [feature(**data(name))]}), "files of this machine, found") for name in ELSEWHERE),
    ],
)
def test_what_is_no_list_of_files_is_refused(tmp_path, content, message):
    (tmp_path / "a.vpc").write_text(content, encoding="latin-1")
    with pytest.raises(FileFormatError, match=message) as caught:
        files_of(tmp_path / "a.vpc")
    assert str(caught.value).startswith(f"{tmp_path / 'a.vpc'}: ")


def test_a_file_called_as_standard_input_is_a_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_vpc(Path("a.vpc"), feature(**data("-")))
    assert files_of(Path("a.vpc")) == [tmp_path / "-"]


def test_the_files_of_a_list_are_read_as_one_cloud(tmp_path):
    points = np.random.default_rng(0).random((30, 3))
    for name, rows in (("a.ply", slice(20)), ("b.csv", slice(20, 30))):
        gppcs.write(tmp_path / name, gppcs.PointCloud(points[rows], {"label": np.arange(30)[rows]}))
    vpc = write_vpc(tmp_path / "a.VPC", feature(**data("a.ply")), feature(**data("b.csv")))
    cloud = gppcs.read(vpc)
    np.testing.assert_array_equal(cloud.points, points)
    assert cloud.attributes["label"].tolist() == list(range(30))
    box = [0, 0, 0.5, 0.5]
    np.testing.assert_array_equal(gppcs.open(vpc, inside=box).read().points, points[(points[:, :2] <= 0.5).all(axis=1)])
    assert load(vpc).cloud == cloud
    (tmp_path / "b.csv").unlink()
    with pytest.raises(FileNotFoundError, match=r"b\.csv"):
        gppcs.read(vpc)


def test_coordinate_systems_of_a_list(tmp_path, two_systems, monkeypatch):
    vpc = write_vpc(tmp_path / "a.vpc", *(feature(**data(str(path))) for path in two_systems))
    with pytest.raises(FileFormatError, match=r"b\.las: expected one coordinate system .* --assume-same-crs"):
        gppcs.read(vpc)
    cloud = gppcs.open(vpc, assume_same_crs=True).read()
    assert (len(cloud), cloud.header.crs) == (1_000, "UTM 32N")
    bare = gppcs.PointCloud(cloud.points[:500], {name: v[:500] for name, v in cloud.attributes.items()})
    gppcs.write(tmp_path / "bare.las", bare)
    for names in (["bare.las", "b.las"], ["b.las", "bare.las"]):
        vpc = write_vpc(tmp_path / "a.vpc", *(feature(**data(name)) for name in names))
        with pytest.warns(UserWarning, match="ETRS89 / UTM 32N, counts"):
            assert gppcs.read(vpc).header.crs == "ETRS89 / UTM 32N"
        monkeypatch.setattr(copc, "PROGRAM", 10**12)
        with pytest.warns(UserWarning, match="ETRS89 / UTM 32N, counts"), CloudFiles([vpc]) as files:
            copc.write_beyond_memory(tmp_path / "a.copc.laz", files, None, False, 1, Timer(), True, False)
        assert gppcs.read(tmp_path / "a.copc.laz").header.crs == "ETRS89 / UTM 32N"
    with pytest.raises(ParameterError, match="expected `assume_same_crs` to be True or False, found 1"):
        gppcs.open(vpc, assume_same_crs=1).read()
