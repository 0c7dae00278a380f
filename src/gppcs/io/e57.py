"""Reads and writes E57 files by the nodes of libE57Format, which pye57 brings.

pye57's own `write_scan_raw` rounds coordinates to single precision. Its `read_scan_raw` knows few fields, and does not
tell whether all points were read.
"""

import hashlib
import os
import re
import shutil
import tempfile
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import BufferedReader
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from gppcs.clouds.cloud import NORMALS, PointCloud
from gppcs.clouds.colours import full_scale
from gppcs.clouds.columns import COLOUR, Column
from gppcs.clouds.header import Header
from gppcs.engine.extras import require_pye57
from gppcs.errors import FileFormatError, OutputError
from gppcs.io.columns import column_name, columns_of, exact_type, with_byte_colours
from gppcs.io.format import Format, Reader, begins, keeping, read_at_once
from gppcs.io.joining import joined
from gppcs.io.rows import check_unpacked, damaged, ends_early, reported

_CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_COLOURS = ("colorRed", "colorGreen", "colorBlue")
_ATTRIBUTES = {
    **dict(zip(_COLOURS, COLOUR, strict=True)),
    **dict(zip(("nor:normalX", "nor:normalY", "nor:normalZ"), NORMALS, strict=True)),
    "intensity": "intensity",
    "timeStamp": "time",
    "rowIndex": "row",
    "columnIndex": "column",
}
_NO_POSE = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
_FINE = 1 / 257  # Scale of colours of 16 bits: other programs read them as numbers from 0 to 255.
_TYPES = [np.dtype(name) for name in ("u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8")]


@dataclass(frozen=True, eq=False)
class E57Header(Header):
    """What an E57 file says of the whole cloud."""

    coordinate_metadata: str = ""  # the coordinate reference system, as well-known text

    @property
    def crs(self) -> str | None:
        """The coordinate reference system as well-known text; None if it is not known."""
        return self.coordinate_metadata or None

    def contents(self) -> list[str]:
        """Return in words whether there is a coordinate system."""
        return ["the coordinate system"] if self.coordinate_metadata else []


def open_e57(file: BufferedReader) -> Reader:
    """Open an E57 file to read all scans, each moved by its pose, without points that have no valid position."""
    with _opened(file) as (_, scans):
        return read_at_once(file, _read, _size(scans))


def _size(scans: list[Any]) -> int:
    """Return how many bytes all values of scans take in memory."""
    return sum(8 * scan.point_count * len(scan.point_fields) for scan in scans)


@contextmanager
def _opened(file: BufferedReader) -> Iterator[tuple[Any, list[Any]]]:
    """Yield an open E57 file of pye57, and the headers of its scans; errors in the block are those of the file."""
    pye57 = require_pye57()
    size = os.fstat(file.fileno()).st_size
    _check_xml(file, size)
    is_named = isinstance(file.name, str | os.PathLike) and os.path.isfile(file.name)  # unlike a temporary copy
    errors = (pye57.libe57.E57Exception, RuntimeError, ValueError, TypeError, AttributeError, LookupError)
    with reported("libE57Format", "a whole E57 file", errors):
        opened = pye57.E57(os.path.abspath(file.name) if is_named else f"/dev/fd/{file.fileno()}")
        root = opened.root
        nodes = root["data3D"] if root.isDefined("data3D") else []
        scans = [opened.get_header(i) for i in range(len(nodes)) if nodes[i].isDefined("points")]
        scans = [scan for scan in scans if scan.point_count or scan.point_fields]
        if not scans:
            raise FileFormatError(f"expected a scan of points in the E57 file, found {len(nodes)} without")
        check_unpacked(_size(scans), size, spare=0)  # values of constant fields take no bytes in a file
        yield opened, scans


def _read(file: BufferedReader) -> tuple[PointCloud, list[str]]:
    """Return the points of all scans, with the attributes that all have, and in words what is left out."""
    with _opened(file) as (opened, scans):
        root, count = opened.root, sum(scan.point_count for scan in scans)
        crs = root["coordinateMetadata"].value() if root.isDefined("coordinateMetadata") else ""
        tables = [_table(opened.image_file, scan) for scan in scans]
    names = [name for name in tables[0] if all(name in table for table in tables)]
    clouds = [PointCloud.from_columns({name: table[name] for name in names}) for table in tables]
    cloud = joined(clouds)
    if len(clouds) > 1:
        numbers = np.repeat(np.arange(len(clouds), dtype=np.int32), list(map(len, clouds)))
        cloud = replace(cloud, attributes={**cloud.attributes, "scan": numbers})
    skipped = [f"points without a valid position ({count - len(cloud):,})"] if len(cloud) < count else []
    fields = {field for scan in scans for field in scan.point_fields if not field.startswith(("cart", "spher"))}
    described = [scan for scan in scans if _name_of(scan) or _pose(scan) != _NO_POSE]
    skipped += [f"names and poses of scans ({len(described):,})"] if described else []
    skipped += [f"field {field}" for field in sorted(fields) if _name(field) not in names]
    return replace(cloud, header=E57Header(crs) if crs else None), skipped


def _name_of(scan: Any) -> str:
    """Return the name that a user gave to a scan; empty if there is none."""
    name = str(scan.node["name"].value()) if scan.node.isDefined("name") else ""
    return "" if re.fullmatch(r"Scan \d+", name) else name  # which pye57 gives to all


def _check_xml(file: BufferedReader, size: int) -> None:
    """Raise an error if the XML part is not in UTF-8, or declares entities, which could grow to any size."""
    header = file.read(48)
    offset, length, page = (int.from_bytes(header[start : start + 8], "little") for start in (24, 32, 40))
    if not header.startswith(b"ASTM-E57") or page != 1024 or offset > size or length > size:
        raise damaged("a whole E57 file", "a header that does not fit it")
    file.seek(offset - offset % page)
    pages = file.read(length + length // 100 + 4 * page)
    xml = b"".join(pages[i : i + page - 4] for i in range(0, len(pages), page))  # without checksums at the ends
    xml = xml[offset % page :][:length].strip()
    encoding = re.search(rb"encoding\s*=\s*[\"']([^\"']*)", xml.partition(b"?>")[0])
    if not xml.startswith((b"<", b"\xef\xbb\xbf<")) or (encoding and encoding[1].lower() != b"utf-8"):
        raise FileFormatError("expected XML in UTF-8 in the E57 file, found another encoding")
    if any(word in xml for word in (b"<!DOCTYPE", b"<!ENTITY", b"\0")):
        raise FileFormatError("expected XML without declarations in the E57 file, found some")


def _table(image: Any, scan: Any) -> dict[str, Column]:
    """Return the coordinates of the valid points of a scan, moved by its pose, and their other numbers, by name."""
    prototype = require_pye57().libe57.StructureNode(scan.points.prototype())
    types = {field: dtype for field in scan.point_fields if (dtype := _dtype(prototype[field]))}
    axes = next((axes for axes in (_CARTESIAN, _SPHERICAL) if types.keys() >= set(axes)), None)
    if axes is None:
        listed = ", ".join(map(repr, scan.point_fields)) or "nothing"
        raise FileFormatError(f"expected cartesian or spherical coordinates for each point, found {listed}")
    arrays, buffers = _buffers(image, types, scan.point_count)
    if scan.point_count:  # of none, libE57Format makes no reader
        reader = scan.points.reader(buffers)
        length = reader.read()
        reader.close()
        if length < scan.point_count:
            raise ends_early("point", length, scan.point_count)
    values = {field: array.astype(types[field], copy=False) for field, array in arrays.items()}
    for field, array in arrays.items():
        node = prototype[field]
        if field.startswith("color") and types[field] == np.float64 and getattr(node, "scale", float)() == _FINE:
            values[field] = np.rint(array * 257).astype(np.uint16)
    states = f"{axes[0][:9]}InvalidState"  # 0 of a valid point
    if states in values:
        is_valid = values[states] == 0
        values = {field: array[is_valid] for field, array in values.items()}
    table = dict(zip("xyz", _moved(scan, [values[axis] for axis in axes], axes == _SPHERICAL), strict=True))
    for field in values:
        if not field.startswith(("cartesian", "spherical")):
            if _name(field) in table:
                raise FileFormatError(f"expected fields of different names, found {_name(field)!r} twice")
            table[_name(field)] = values[field]
    return table


def _name(field: str) -> str:
    """Return the name of the attribute that a field becomes."""
    return _ATTRIBUTES.get(field, field.removeprefix("gppcs:").replace(":", "_"))


def _dtype(node: Any) -> np.dtype[Any] | None:
    """Return the type of the numbers of a field; None if it holds others."""
    libe57 = require_pye57().libe57
    if isinstance(node, libe57.FloatNode):
        return np.dtype("f4" if node.precision() == libe57.E57_SINGLE else "f8")
    if isinstance(node, libe57.IntegerNode):
        bounds = np.array([node.minimum(), node.maximum()], np.int64)
        integers = (to for to in _TYPES if to.kind in "iu" and np.array_equal(bounds.astype(to), bounds))
        return next(integers, np.dtype("f8"))
    return np.dtype("f8") if isinstance(node, libe57.ScaledIntegerNode) else None


def _buffers(image: Any, types: Mapping[str, np.dtype[Any]], n: int) -> tuple[dict[str, Column], Any]:
    """Return arrays for n values of each field, and the buffers through which libE57Format fills or reads them."""
    libe57 = require_pye57().libe57
    arrays = {field: np.empty(n, np.float32 if dtype == np.float32 else np.float64) for field, dtype in types.items()}
    buffers = libe57.VectorSourceDestBuffer()
    for field, values in arrays.items():
        buffers.append(libe57.SourceDestBuffer(image, field, values, n, True, True))
    return arrays, buffers


def _pose(scan: Any) -> list[float]:
    """Return how a scan is turned, a quaternion, and where it stands."""
    # pye57's own properties take the numbers in the order of the file.
    names = [*(f"pose/rotation/{axis}" for axis in "wxyz"), *(f"pose/translation/{axis}" for axis in "xyz")]
    return [scan[name].value() if scan.node.isDefined(name) else float(name.endswith("w")) for name in names]


def _moved(scan: Any, columns: list[Column], are_spherical: bool) -> list[Column]:
    """Return coordinates moved by the pose of a scan, in their own type if it has none."""
    pye57 = require_pye57()
    if are_spherical:
        columns = list(pye57.utils.convert_spherical_to_cartesian(np.stack(columns, axis=1, dtype=np.float64)).T)
    pose = _pose(scan)
    if not (np.isfinite(pose).all() and any(pose[:4])):
        raise FileFormatError(f"expected a pose of finite numbers, found {pose}")
    if pose == _NO_POSE:
        return columns
    return list(pye57.E57.to_global(np.stack(columns, axis=1), np.array(pose[:4]), np.array(pose[4:])).T)


def write_e57(file: BinaryIO, cloud: PointCloud) -> None:
    """Write an E57 file of one scan, without a pose; attributes that E57 has not become fields of an extension."""
    libe57 = require_pye57().libe57
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "cloud.e57")
        try:
            image = libe57.ImageFile(str(path), "w")
            _write_scan(image, cloud)
            image.close()
        except libe57.E57Exception as error:
            reason = str(error).partition("\n")[0]
            raise OutputError(f"{path}: expected to write an E57 file, but libE57Format reports: {reason}") from error
        with open(path, "rb") as written:
            shutil.copyfileobj(written, file)


def _write_scan(image: Any, cloud: PointCloud) -> None:
    libe57 = require_pye57().libe57
    normals = "http://www.libe57.org/E57_NOR_surface_normals.txt"
    for prefix, uri in (("", libe57.E57_V1_0_URI), ("nor", normals), ("gppcs", "urn:gppcs:attributes")):
        image.extensionsAdd(prefix, uri)
    columns = _columns_written(cloud)
    limits = _limits(columns)
    need_16_bits = any(columns[field].max(initial=0) > 255 for field in _COLOURS if field in columns)
    prototype = libe57.StructureNode(image)
    for field, values in columns.items():
        if values.dtype.kind == "f":
            precision = libe57.E57_SINGLE if values.dtype.itemsize == 4 else libe57.E57_DOUBLE
            prototype.set(field, libe57.FloatNode(image, 0.0, precision))
        elif field in _COLOURS and values.dtype == np.uint16 and need_16_bits:
            prototype.set(field, libe57.ScaledIntegerNode(image, 0, 0, 65535, _FINE, 0.0))
            columns[field] = values * _FINE
        else:
            bounds = np.iinfo(values.dtype)
            prototype.set(field, libe57.IntegerNode(image, 0, int(bounds.min), int(bounds.max)))
    points = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
    digest = hashlib.blake2b(cloud.points.tobytes(), digest_size=16).digest()
    guid = f"{{{uuid.UUID(bytes=digest)}}}"  # of the content, so that the same cloud gives the same file
    scan = _fill(image, libe57.StructureNode(image), {"guid": guid, **limits, "points": points})
    scans = libe57.VectorNode(image, True)
    about = {
        "formatName": "ASTM E57 3D Imaging Data File",
        "guid": guid,
        "versionMajor": libe57.E57_FORMAT_MAJOR,
        "versionMinor": libe57.E57_FORMAT_MINOR,
        "coordinateMetadata": cloud.header.crs or "" if isinstance(cloud.header, E57Header) else "",
        "data3D": scans,
    }
    _fill(image, image.root(), about)
    scans.append(scan)
    arrays, buffers = _buffers(image, {field: values.dtype for field, values in columns.items()}, len(cloud))
    for field, values in columns.items():
        arrays[field][:] = values
    writer = points.writer(buffers)
    writer.write(len(cloud))
    writer.close()


def _fill(image: Any, node: Any, values: Mapping[str, Any]) -> Any:
    """Set texts, numbers, nodes and further values by name in a node, and return it."""
    libe57 = require_pye57().libe57
    kinds = {str: libe57.StringNode, int: libe57.IntegerNode, float: libe57.FloatNode}
    for name, value in values.items():
        if isinstance(value, dict):
            value = _fill(image, libe57.StructureNode(image), value)
        node.set(name, kinds[type(value)](image, value) if type(value) in kinds else value)
    return node


def _limits(columns: Mapping[str, Column]) -> dict[str, dict[str, float]]:
    """Return between which values intensity and colours lie, by which other programs scale them."""
    limits = {}
    finite = columns.get("intensity", np.empty(0))
    finite = finite[np.isfinite(finite)]
    if len(finite):
        limits["intensityLimits"] = {"intensityMinimum": float(finite.min()), "intensityMaximum": float(finite.max())}
    if "colorRed" in columns:
        full = full_scale(np.stack([columns[field] for field in _COLOURS]))
        ends = {"Minimum": 0.0, "Maximum": min(full, 255.0)}
        limits["colorLimits"] = {f"{field}{end}": value for field in _COLOURS for end, value in ends.items()}
    return limits


def _columns_written(cloud: PointCloud) -> dict[str, Column]:
    """Return what is written of each point, by the name of its field."""
    columns = columns_of(cloud, types=_TYPES)
    fields = dict(zip("xyz", _CARTESIAN, strict=True)) | {name: field for field, name in _ATTRIBUTES.items()}
    for group in (COLOUR, NORMALS):  # E57 allows all of these or none
        if not set(group) <= set(columns):
            fields.update({name: f"gppcs:{name}" for name in group})
    return {fields.get(name, f"gppcs:{name}"): values for name, values in columns.items()}


def _stored(cloud: PointCloud) -> PointCloud:
    """Return a cloud as `write_e57` stores it."""
    require_pye57()  # before long work, not at its end

    def holds(name: str, values: Column) -> object:
        return exact_type(values, _TYPES) and re.fullmatch(r"[A-Za-z_][A-Za-z0-9_.-]*", column_name(name))

    return keeping(with_byte_colours(cloud), holds, E57Header, plain_names=True)


FORMAT = Format("E57", (".e57",), open_e57, write_e57, begins(rb"ASTM-E57"), _stored)
