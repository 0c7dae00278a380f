"""Virtual point clouds: lists of files."""

import json
import os
from pathlib import Path

import pytest

from gppcs.errors import FileFormatError
from gppcs.io import files_of


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
    )
    names = ["b ü%20.laz", "deeper/../a.copc.laz", "/elsewhere/c.las", "/elsewhere/d e.las", "f.laz"]
    assert files_of(vpc) == [tmp_path / name for name in names]
    os.chdir(tmp_path)
    assert files_of(Path("a.vpc"))[0] == Path("b ü%20.laz")


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
        (json.dumps({"features": [feature(**data("https://a.org/a.laz"))]}), "found https://a.org/a.laz; get them"),
    ],
)
def test_what_is_no_list_of_files_is_refused(tmp_path, content, message):
    (tmp_path / "a.vpc").write_text(content, encoding="latin-1")
    with pytest.raises(FileFormatError, match=message) as caught:
        files_of(tmp_path / "a.vpc")
    assert str(caught.value).startswith(f"{tmp_path / 'a.vpc'}: ")
