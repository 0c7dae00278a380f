"""LAS and LAZ files come back with every dimension and record, as laspy reads them; damaged ones are refused."""

import struct
from dataclasses import replace
from datetime import date

import laspy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from laspy.vlrs.known import WktCoordinateSystemVlr

import gppcs
from formats import load, losses, overwrite
from gppcs.clouds.cloud import PointCloud
from gppcs.errors import FileFormatError, OutputError
from gppcs.io import read, to_laspy, write
from las_file import EXTRA_TYPES, WKT, random_las, save

SUFFIXES = [".las", ".laz"]
FORMATS = [
    *((version, number) for version in ("1.2", "1.3", "1.4") for number in range(4)),
    *((version, number) for version in ("1.3", "1.4") for number in (4, 5)),
    *(("1.4", number) for number in range(6, 11)),
]


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(("version", "number"), FORMATS)
def test_a_part_of_a_file_has_the_bytes_of_the_kept_points(tmp_path, version, number, suffix):
    original = random_las(version, number)
    cloud = read(save(original, tmp_path / f"in{suffix}"))
    original = laspy.read(tmp_path / f"in{suffix}")
    assert list(cloud.attributes) == list(original.point_format.dimension_names)[3:]
    assert np.array_equal(cloud.points, original.xyz)
    np.testing.assert_array_equal(cloud.attributes["scaled"], np.asarray(original["scaled"]))  # physical values
    assert cloud.attributes[f"extra {EXTRA_TYPES.index('3f8')}"].shape == (300, 3)
    indices = np.array([5, 250, 0, 17])
    for target in SUFFIXES:
        write(tmp_path / f"out{target}", cloud.take(indices), force=True)
        found = laspy.read(tmp_path / f"out{target}")
        assert found.points.array.tobytes() == original.points.array[indices].tobytes()
        assert list(found.point_format.dimension_names) == list(original.point_format.dimension_names)
        assert found.header.point_count == len(indices)
        assert np.array_equal([found.header.mins, found.header.maxs], [found.xyz.min(axis=0), found.xyz.max(axis=0)])
        returns = np.bincount(np.asarray(found.return_number), minlength=16)[1:]
        kept = 15 if version == "1.4" else 5
        assert found.header.number_of_points_by_return[:kept].tolist() == returns[:kept].tolist()
        for name in ("version", "file_source_id", "system_identifier", "uuid", "creation_date"):
            assert getattr(found.header, name) == getattr(original.header, name)
        assert found.header.generating_software == "gppcs"
        assert found.header.global_encoding.value == original.header.global_encoding.value
        assert bytes_of(found.vlrs) == bytes_of(original.vlrs)
        assert bytes_of(found.evlrs or []) == bytes_of(original.evlrs or [])
        assert read(tmp_path / f"out{target}") == cloud.take(indices)


@pytest.mark.parametrize("suffix", [".las", ".laz", ".copc.laz"])
def test_new_files_are_of_today_or_of_the_day_that_the_environment_sets(tmp_path, monkeypatch, suffix):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "981173106")
    write(tmp_path / f"a{suffix}", np.eye(3))
    monkeypatch.delenv("SOURCE_DATE_EPOCH")
    days = [date.today()]
    write(tmp_path / f"b{suffix}", np.eye(3))
    days.append(date.today())  # midnight may have passed
    found = []
    for name in "ab":
        with laspy.open(tmp_path / f"{name}{suffix}") as file:
            found.append(file.header.creation_date)
    assert found[0] == date(2001, 2, 3)
    assert found[1] in days
    assert read(tmp_path / f"a{suffix}") == read(tmp_path / f"b{suffix}")


def bytes_of(records):
    """The bytes of laspy's records, but those of compression, and without minima and maxima of extra bytes."""
    for record in records:
        for description in getattr(record, "extra_bytes_structs", []):
            description.options &= 0b11111001 if description.data_type else 0xFF
            description.partial_reset()
    kept = [record for record in records if record.user_id != "laszip encoded"]
    return [(record.user_id, record.record_id, record.description, record.record_data_bytes()) for record in kept]


@pytest.mark.parametrize("stored", ["u2", "i4", "3i4"])
def test_scaled_extra_bytes_are_their_physical_values(tmp_path, stored):
    """Heights of 0 to 50 m in centimetres; in conditions, and written back as they were."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    width = 3 if stored[0] == "3" else 1
    scales, offsets = [0.01] * width, [-5.0] * width
    header.add_extra_dim(laspy.ExtraBytesParams("height", stored, scales=scales, offsets=offsets, description="above"))
    original = laspy.LasData(header)
    original.x, original.y, original.z = np.random.default_rng(0).random((3, 2_000))
    heights = np.round(np.linspace(0.0, 50.0, 2_000), 2)
    original["height"] = np.repeat(heights[:, None], 3, axis=1) if width > 1 else heights
    cloud = read(save(original, tmp_path / "a.las"))
    np.testing.assert_allclose(cloud.attributes["height"], original["height"], atol=1e-9)
    write(tmp_path / "b.las", cloud.take(np.arange(0, 2_000, 2)))
    found = laspy.read(tmp_path / "b.las")
    np.testing.assert_array_equal(found.points.array["height"], original.points.array["height"][::2])
    assert found.point_format.dimension_by_name("height").is_scaled
    assert to_laspy(cloud).points.array["height"].tobytes() == original.points.array["height"].tobytes()
    if width == 1:
        assert len(gppcs.open(tmp_path / "a.las", only="height > 25").read()) == np.count_nonzero(heights > 25) == 1_000
    moved = replace(cloud, attributes={"height": cloud.attributes["height"] + 1e-3})
    write(tmp_path / "d.las", moved)  # no multiples of the scale: stored as they are
    np.testing.assert_array_equal(np.asarray(laspy.read(tmp_path / "d.las")["height"]), moved.attributes["height"])


def test_marks_of_no_data_are_kept_and_noted_where_they_are_scaled(tmp_path):
    header = laspy.LasHeader(point_format=6, version="1.4")
    for name, scale in (("height", {"scales": [0.01], "offsets": [0.0]}), ("count", {})):
        header.add_extra_dim(laspy.ExtraBytesParams(name, "i2", no_data=[-9999], **scale))
    las = laspy.LasData(header)
    las.x = las.y = las.z = np.arange(3.0)
    las.points.array["height"] = las["count"] = [1, -9999, 2]
    cloud, _, unread = load(save(las, tmp_path / "a.las"))
    assert unread == ["the mark of no data of attribute height (-9999 is read as a number, with its scale)"]
    write(tmp_path / "b.las", replace(cloud, attributes={**cloud.attributes, "more": np.arange(3.0)}))
    with laspy.open(tmp_path / "b.las") as file:
        [record] = file.header.vlrs.get("ExtraBytesVlr")
        assert {part.format_name(): part.no_data for part in record.extra_bytes_structs} == {
            "height": [-9999], "count": [-9999], "more": None
        }  # fmt: skip


@pytest.mark.parametrize(("kind", "shape"), [("u4", (300, 8)), ("u1", (300, 5)), ("", (300,))])
def test_extra_bytes_that_no_record_describes(tmp_path, kind, shape):
    original = random_las("1.2", 0, extra=(kind,)) if kind else laspy.LasData(laspy.LasHeader(point_format=0))
    if not kind:
        original.header.add_extra_dim(laspy.ExtraBytesParams("one", "u1"))
        original = laspy.LasData(original.header)
        original.x = original.y = original.z = np.arange(300.0)
    path = save(original, tmp_path / "in.las")
    content = path.read_bytes().replace(b"LASF_Spec\0", b"SomeSpec\0\0")
    path.write_bytes(content)
    cloud = read(path)
    assert cloud.attributes["ExtraBytes"].shape == shape
    write(tmp_path / "out.las", cloud)
    assert (tmp_path / "out.las").read_bytes()[100:] == content[100:]


def test_waveforms_in_the_file_are_kept(tmp_path):
    path = save(random_las("1.4", 4), tmp_path / "in.las")
    content = bytearray(path.read_bytes())
    packets = struct.pack("<H16sHQ32s", 0, b"LASF_Spec", 65535, 1000, b"packets") + bytes(1000)
    content[6] |= 0b10
    content[227:235] = len(content).to_bytes(8, "little")
    content[235:247] = struct.pack("<QI", len(content), 1)
    path.write_bytes(content + packets)
    write(tmp_path / "out.las", read(path).take(np.arange(7)))
    out = (tmp_path / "out.las").read_bytes()
    start = int.from_bytes(out[227:235], "little")
    assert out[start:] == packets


def geo_keys(*keys):
    return laspy.VLR("LASF_Projection", 34735, "", np.array([[1, 1, 0, len(keys)], *keys], "<u2").tobytes())


def texts(text):
    return laspy.VLR("LASF_Projection", 34737, "", text + b"\0")


@pytest.mark.parametrize(
    ("records", "uses_wkt", "expected"),
    [
        ([], False, None),
        ([WktCoordinateSystemVlr(WKT)], True, "NAD83 / Oregon (EPSG:2991)"),
        ([WktCoordinateSystemVlr(WKT), geo_keys((3072, 0, 1, 32610))], False, "EPSG:32610"),
        ([WktCoordinateSystemVlr('LOCAL_CS["my\nroom",UNIT["metre",1]]')], True, "my room"),
        ([WktCoordinateSystemVlr('PROJCRS["A",ID["EPSG",7]]')], True, "A (EPSG:7)"),
        ([WktCoordinateSystemVlr("nonsense")], True, None),
        ([geo_keys((3072, 0, 1, 32610), (1026, 34737, 6, 2)), texts(b"..UTM 1|B|")], False, "UTM 1 (EPSG:32610)"),
        ([geo_keys((3072, 0, 1, 32767), (3073, 34737, 5, 0)), texts(b"Mine|")], False, "Mine"),
    ],
)
def test_the_coordinate_system_is_named(tmp_path, records, uses_wkt, expected):
    las = laspy.LasData(laspy.LasHeader(version="1.4", point_format=1))
    las.header.vlrs.extend(records)
    las.xyz = np.zeros((2, 3))
    path = save(las, tmp_path / "a.las")
    overwrite(path, 6, [16 * uses_wkt])  # the global encoding; some versions of laspy set it by themselves
    cloud = read(path)
    assert cloud.header.crs == expected
    assert gppcs.info(cloud).crs == expected
    remark = f"coordinate system {expected or 'of unknown name'}"
    assert losses("a.ply", cloud) == ([remark] if records else [])


def test_attributes_may_come_go_and_change(tmp_path):
    original = random_las("1.2", 1)
    cloud = read(save(original, tmp_path / "a.las"))
    attributes = dict(cloud.attributes)
    del attributes["intensity"], attributes["extra 0"]
    attributes |= {"score": np.arange(300.0), "index": np.arange(300), "flag": np.arange(300) % 2 == 0}
    attributes["scaled"] = np.arange(300, dtype=np.float32) / 3  # no multiples of the scale
    attributes["column"] = np.arange(300)[:, None]
    attributes["embedding"] = np.arange(1500, dtype=np.float32).reshape(300, 5)
    write(tmp_path / "b.las", replace(cloud, attributes=attributes))
    found = laspy.read(tmp_path / "b.las")
    assert found.point_format.id == 1
    assert not np.asarray(found.intensity).any()
    extra = [f"extra {i}" for i in range(1, 31)]
    extra += ["scaled", "score", "index", "flag", "column", *(f"embedding_{i}" for i in range(5))]
    assert sorted(found.point_format.extra_dimension_names) == sorted(extra)
    assert found.points.array["scaled"].tobytes() == attributes["scaled"].tobytes()
    assert not found.point_format.dimension_by_name("scaled").is_scaled
    assert found["index"].dtype == np.int64
    assert found["flag"].dtype == np.uint8


@pytest.mark.parametrize(
    ("attributes", "number", "extra"),
    [
        ({}, 0, []),
        ({"gps_time": np.array([0.1, np.inf])}, 1, []),
        ({"red": np.array([0, 255], np.uint8), "gps_time": np.array([0.1, 2])}, 3, []),
        ({"classification": np.array([31, 0])}, 0, []),
        ({"classification": np.array([32, 0])}, 6, []),
        ({"nir": np.array([1, 2])}, 8, []),
        ({"return_number": np.array([1, 9])}, 6, []),
        ({"red": np.array([0.5, 1]), "nx": np.array([0.5, 1])}, 0, ["red", "nx"]),
    ],
)
def test_the_point_format_is_one_that_holds_the_attributes(tmp_path, attributes, number, extra):
    path = tmp_path / "a.laz"
    write(path, PointCloud([[1.5, 2, 3], [4, 5, 6]], attributes))
    found = laspy.read(path)
    assert found.point_format.id == number
    assert list(found.point_format.extra_dimension_names) == extra
    for name, values in attributes.items():
        assert np.array_equal(np.asarray(found[name]), values)
    assert np.array_equal(found.xyz, [[1.5, 2, 3], [4, 5, 6]])


def test_names_of_pdal_and_cloudcompare_become_dimensions(tmp_path):
    """Names without regard to case, blanks and underscores; whole floats count as whole numbers."""
    (tmp_path / "a.csv").write_text(
        "X,Y,Z,Intensity,ReturnNumber,Scalar_Classification,GpsTime,Red,Green,Blue,Deviation\n"
        "1,2,3,120.0,1,2,12.5,1000,2000,3000,7\n4,5,6,121.0,2,6,12.6,1100,2100,3100,8\n"
    )
    cloud = read(tmp_path / "a.csv")
    assert losses("a.las", cloud)[0] == "the name 'Intensity' (it becomes intensity)"
    write(tmp_path / "a.las", cloud)
    found = laspy.read(tmp_path / "a.las")
    assert list(found.point_format.extra_dimension_names) == ["Deviation"]
    assert (found.intensity.tolist(), found.classification.array.tolist()) == ([120, 121], [2, 6])
    assert (found.gps_time.tolist(), found.green.tolist()) == ([12.5, 12.6], [2000, 2100])


def test_fractions_as_intensities_and_colours_get_16_bits(tmp_path):
    fractions = {"intensity": np.array([0.25, 0.5, 1])}
    path = tmp_path / "a.las"
    with pytest.raises(OutputError, match=r"intensity \(0.25 to 1 become 16384 to 65535\)"):
        write(path, PointCloud(np.eye(3), fractions))
    write(path, PointCloud(np.eye(3), fractions), lossy=True)
    assert laspy.read(path).intensity.tolist() == [16384, 32768, 65535]
    decibels = {"intensity": np.array([-20.5, np.nan, 0])}
    write(path, PointCloud(np.eye(3), decibels), lossy=True, force=True)
    assert laspy.read(path).intensity.tolist() == [0, 0, 65535]
    assert losses("a.las", PointCloud(np.eye(3), decibels))[0].endswith("intensity (-20.5 to 0 become 0 to 65535)")
    for numbers in ([-2048, 0, 2047], [-2048.0, 0.0, 2047.0], [0, 40_950, 81_900]):  # as in PTS, or of more bits
        write(path, PointCloud(np.eye(3), {"intensity": np.array(numbers)}), lossy=True, force=True)
        np.testing.assert_allclose(np.asarray(laspy.read(path).intensity, float), [0, 32768, 65535], atol=9)
        with pytest.raises(OutputError, match=rf"{numbers[0]:g} to {numbers[2]:g} become 0 to 65535"):
            write(path, PointCloud(np.eye(3), {"Intensity": np.array(numbers)}), force=True)
    colours = {name: np.array([0, 51, k], np.float32) / 255 for k, name in enumerate(("red", "green", "blue"))}
    write(path, PointCloud(np.eye(3), colours), force=True)  # nothing is lost beyond 16 bits
    assert laspy.read(path).blue.tolist() == [0, 51 * 257, 2 * 257]
    scaled = losses("a.las", PointCloud(np.eye(3), colours))
    assert scaled[0] == "the scale of attribute red (0 to 0.2 become 0 to 13107)"


@pytest.mark.parametrize("names", [["n" * 33], ["X"], [f"a{i}" for i in range(342)]])
def test_names_that_extra_bytes_cannot_have(tmp_path, names):
    with pytest.raises(OutputError):
        write(tmp_path / "a.las", PointCloud(np.zeros((2, 3)), dict.fromkeys(names, np.zeros(2))))
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("points", "scale"),
    [
        ([[500_000.123, 0, 0], [500_001.987, 0, 0]], 0.001),
        ([[5e9 + 0.5, 0, 0], [5e9, 0, 0]], 0.1),
        ([[0.41, 13.07, -99.99], [56.29, 0.02, 1e5 + 0.57]], 0.01),
    ],
)
def test_the_scale_is_the_coarsest_that_is_exact(tmp_path, points, scale):
    write(tmp_path / "a.las", points)
    assert laspy.read(tmp_path / "a.las").header.scales[0] == scale
    np.testing.assert_allclose(read(tmp_path / "a.las").points, points, rtol=4e-16)  # 41 times 0.01 is not quite 0.41


def test_coordinates_are_rounded_a_little_but_not_far_unasked(tmp_path):
    points = np.random.default_rng(0).random((1000, 3)) * [100, 1, 1]
    assert losses("a.las", PointCloud(points)) == ["the last digits of coordinates (which move by at most 5e-08)"]
    write(tmp_path / "a.las", points)
    found = read(tmp_path / "a.las").points
    assert (to_laspy(PointCloud(points)).xyz == found).all()
    assert (np.abs(found - points) <= [0.51e-7, 0.51e-9, 0.51e-9]).all()
    points = 1.3 + points[:9] * 1e-9
    with pytest.raises(OutputError, match=r"cannot hold: the last digits of coordinates \(which move by"):
        write(tmp_path / "b.las", points)
    with pytest.raises(gppcs.InputError, match="the last digits of coordinates"):
        to_laspy(PointCloud(points))
    write(tmp_path / "b.las", points, lossy=True)
    cloud = read(save(random_las("1.2", 0), tmp_path / "c.las"))
    moved = replace(cloud, points=cloud.points / 3)  # which needs a scale of its own
    assert losses("d.las", moved) == ["the last digits of coordinates (which move by at most 0.003)"]


@pytest.mark.parametrize("suffix", SUFFIXES)
@given(
    st.integers(0, 6).flatmap(
        lambda n: st.builds(
            PointCloud,
            hnp.arrays("f8", (n, 3), elements=st.floats(allow_nan=False, allow_infinity=False)),
            st.dictionaries(
                st.text("abcXYZ é", min_size=1, max_size=8).filter(lambda name: name not in "XYZ"),
                st.sampled_from(["?", "u1", "i2", "u4", "i8", "u8", "f2", "f4", "f8"]).flatmap(
                    lambda kind: st.sampled_from([(n,), (n, 2), (n, 4)]).flatmap(lambda shape: hnp.arrays(kind, shape))
                ),
                max_size=3,
            ),
        )
    )
)
def test_any_cloud(tmp_path_factory, suffix, cloud):
    path = tmp_path_factory.mktemp("any") / f"a{suffix}"
    if np.abs(cloud.points).max(initial=0.0) > 1e300:
        with pytest.raises(OutputError, match=r"expected .*coordinates"):
            write(path, cloud, lossy=True)
        return
    write(path, cloud, lossy=True)
    found = read(path)
    wide = {name for name, values in cloud.attributes.items() if values.ndim > 1 and values.shape[1] == 4}
    for name, values in cloud.attributes.items():
        if name not in wide:
            kept = found.attributes[name]
        else:
            kept = np.stack([found.attributes[f"{name}_{i}"] for i in range(4)], axis=1)
        assert np.array_equal(kept.astype(values.dtype), values, equal_nan=values.dtype.kind == "f")
    if not any(word.startswith("the last digits") for word in losses(path, cloud)):
        last_digits = 2 * np.spacing(np.abs(cloud.points).max(initial=0.0))  # 41 times 0.01 is not quite 0.41
        assert (np.abs(found.points - cloud.points) <= last_digits).all()
    write(path, found, force=True)  # nothing more is lost
    assert read(path) == found


def bits(number):
    return int.from_bytes(struct.pack("<d", number), "little")


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        ((25, 1), 5, "extended variable-length records in the file"),
        ((94, 2), 226, "at least 227 bytes before the points, found that it gives its own size as 226"),
        ((94, 6), 0, "at least 227 bytes before the points, found that it gives its own size as 0, and 0 as"),
        ((96, 4), 2**31, "the file ends in point 1 of 300"),
        ((104, 1), 11, "laspy reports: PointFormatNotSupported 11"),
        ((105, 2), 10, "laspy reports: Incoherent point size, header says 10"),
        ((107, 4), 2**32 - 1, r"file ends in point 301 of 4294967295"),
        *(((131, 8), bits(scale), "finite scales and offsets") for scale in (0.0, np.nan, np.inf)),
        ((155, 8), bits(np.nan), "finite scales and offsets"),
    ],
)
def test_headers_that_lie(tmp_path, place, value, message):
    path = save(random_las("1.2", 0), tmp_path / "a.las")
    overwrite(path, place[0], value.to_bytes(place[1], "little"))
    with pytest.raises(FileFormatError, match=message):
        read(path)


def test_a_header_that_is_cut_off_does_not_count_records(tmp_path):
    path = save(random_las("1.4", 10), tmp_path / "a.las")
    content = bytearray(path.read_bytes()[:374])
    content[243:247] = (2**24).to_bytes(4, "little")  # each of which would take 0.1 ms
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match=r"at least 375 bytes before the points, found .* in 374 bytes"):
        read(path)


def test_an_unknown_compressor_is_named(tmp_path):
    path = save(random_las("1.2", 0), tmp_path / "a.laz")
    with laspy.open(path) as opened:
        record = opened.header.vlrs.get("LasZipVlr")[0].record_data
    path.write_bytes(path.read_bytes().replace(bytes(record), b"\1" + bytes(record)[1:]))
    with pytest.raises(FileFormatError, match="compressed in chunks, found compressor 1; use LASzip to convert"):
        read(path)


def test_a_header_may_count_more_records_than_there_are(tmp_path):
    path = save(random_las("1.2", 0), tmp_path / "a.las")
    cloud = read(path)
    overwrite(path, 100, b"\xff" * 4)
    assert read(path) == cloud


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_to_do_with_the_start_of_a_file_is_said(tmp_path, suffix):
    path = save(random_las("1.4", 3), tmp_path / f"a{suffix}")
    content = path.read_bytes()
    for length in (0, 4, 226, 300, *range(400, len(content), 7919), len(content) - 1):
        path.write_bytes(content[:length])
        with pytest.raises(FileFormatError, match=r"a\.la[sz]: .*[:;] get "):
            read(path)
