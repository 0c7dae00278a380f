"""gppcs in a pipeline of PDAL, with the dictionaries that its stage filters.python hands over."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import gppcs
import gppcs.pdal

PAGE = Path(__file__).parents[1] / "docs" / "where-you-work.md"


@pytest.fixture
def ins():
    """Return the dimensions of a street as PDAL names them."""
    street = gppcs.sample("street", n_points=5_000)
    number = len(street)
    return {
        **dict(zip("XYZ", street.points.T, strict=True)),
        "Intensity": street.attributes["intensity"],
        "GpsTime": np.arange(number) / 3.0,
        "ScanChannel": np.zeros(number, np.uint8),
        "Classification": street.attributes["marking"].astype(np.uint8),
    }


def test_attributes_have_the_names_of_las_files(ins):
    names = ["Intensity", "GpsTime", "PointSourceId", "ScanChannel", "Red", "NumberOfReturns", "Infrared"]
    expected = ["intensity", "gps_time", "point_source_id", "scanner_channel", "red", "number_of_returns", "nir"]
    assert list(map(gppcs.pdal.attribute_called, names)) == expected
    outs = {}
    gppcs.pdal.simplify(ins, outs, n_points=300, quota={"classification == 1": 100})
    assert (outs["Mask"].sum(), ins["Classification"][outs["Mask"]].sum()) == (300, 100)


def test_what_a_mask_cannot_tell_is_refused(ins):
    for options, message in (
        ({"normals": True}, "neither normals nor scores"),
        ({"scores": True}, "neither normals nor scores"),
        ({"method": gppcs.Voxel(keep="mean")}, "leaves points where they are"),
    ):
        with pytest.raises(gppcs.ParameterError, match=message):
            gppcs.pdal.simplify(ins, {}, n_points=100, **options)


@pytest.mark.parametrize("kind", [np.float32, np.int32])
def test_coordinates_of_any_type_and_far_from_the_origin(ins, kind):
    ins = {name: np.array(values) for name, values in ins.items()}
    for axis, far in zip("XYZ", (500_000, 5_400_000, 0), strict=True):
        ins[axis] = (np.rint(100 * ins[axis]) + 100 * far).astype(kind)
    before, outs = {name: values.copy() for name, values in ins.items()}, {}
    asked = {"n_points": 300, "quota": {"classification == 1": 100}}
    assert gppcs.pdal.simplify(ins, outs, **asked)
    points = np.column_stack([ins[axis].astype(float) for axis in "XYZ"])
    cloud = gppcs.PointCloud(points, {"classification": ins["Classification"]})
    expected = gppcs.simplify(cloud, **asked).indices
    np.testing.assert_array_equal(np.flatnonzero(outs["Mask"]), np.sort(expected))
    for name, values in before.items():
        np.testing.assert_array_equal(ins[name], values)


def stages():
    """Return the stages of the pipeline on the page."""
    (text,) = re.findall(r"```json\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    return json.loads(text)


def test_the_source_on_the_page_works_as_pdal_runs_it(ins):
    (stage,) = (stage for stage in stages() if isinstance(stage, dict))
    module, outs = {}, {}
    exec(compile(stage["source"], stage["module"], "exec"), module)
    assert module[stage["function"]](ins, outs)
    assert outs["Mask"].sum() == 1_000


def test_a_pipeline_of_pdal_keeps_all_dimensions(tmp_path):
    pdal = pytest.importorskip("pdal")
    gppcs.write(tmp_path / "scan.laz", gppcs.sample("street", n_points=5_000))
    reader, stage, _ = stages()
    pipeline = pdal.Pipeline(json.dumps([str(tmp_path / reader), stage]))
    assert pipeline.execute() == 1_000
    assert {"X", "Intensity", "marking"} <= set(pipeline.arrays[0].dtype.names)
