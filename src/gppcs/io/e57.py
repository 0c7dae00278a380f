"""Reads and writes E57 files, by the library libE57Format that pye57 brings."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import struct
import tempfile
import uuid
from collections.abc import Generator, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from io import BufferedReader
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column, cloud_of_columns
from gppcs.clouds.header import Header
from gppcs.engine.extras import require_libe57
from gppcs.errors import FileFormatError, OutputError
from gppcs.io.columns import column_name, columns_of, exact_type
from gppcs.io.format import Format, Reader, from_start, keeping
from gppcs.io.rows import BLOCK, ends_early, reported

_CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_STATES = ("cartesianInvalidState", "sphericalInvalidState")  # 0 for a point, others for a direction or nothing
_NORMALS = "http://www.libe57.org/E57_NOR_surface_normals.txt"
_OWN = "urn:gppcs:attributes"
_PREFIX = "gppcs:"  # of the fields of that extension
_SOURCES = "gppcs:scans"
_POSE = {"rotation": "wxyz", "translation": "xyz"}  # and the numbers of each
_NAMES = {  # of the fields of E57 that have another name as attribute
    "colorRed": "red",
    "colorGreen": "green",
    "colorBlue": "blue",
    "rowIndex": "row",
    "columnIndex": "column",
    "timeStamp": "time",
    "nor:normalX": "nx",
    "nor:normalY": "ny",
    "nor:normalZ": "nz",
}
_FIELDS = {**{name: each for each, name in _NAMES.items()}, "intensity": "intensity"}
_TOGETHER = (("red", "green", "blue"), ("nx", "ny", "nz"))  # E57 allows all of these or none
_ELEMENT = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*")
_INTEGERS = {kind: [np.dtype(f"{kind}{size}") for size in (1, 2, 4, 8)] for kind in "iu"}
_STORED = {*_INTEGERS["i"], *_INTEGERS["u"], np.dtype("f4"), np.dtype("f8")}
_LARGEST = 2**63 - 1  # whole number in an E57 file
_SIGNATURE = b"ASTM-E57"
_HEADER = struct.Struct("<8sIIQQQQ")  # signature, version, and of the XML part offset and length, then size of a page
_PAGE, _CHECKSUM = 1024, 4  # bytes of a page, and at its end of its checksum


@dataclass(frozen=True)
class E57Scan:
    """One scan that went into a cloud. Its points have been rotated, then moved by `translation`, in metres."""

    guid: str = ""
    name: str = ""
    rotation: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)  # a quaternion w, x, y, z
    translation: tuple[float, ...] = (0.0, 0.0, 0.0)

    @property
    def is_moved(self) -> bool:
        """Whether the scan has a pose other than the identity."""
        return (*self.rotation, *self.translation) != (1, 0, 0, 0, 0, 0, 0)

    def moved(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points (N, 3) of the scan in the coordinates of the file."""
        if not self.is_moved:
            return points
        from scipy.spatial.transform import Rotation

        w, *axis = self.rotation
        moved: NDArray[np.float64] = Rotation.from_quat([*axis, w]).apply(points) + np.array(self.translation)
        return moved


@dataclass(frozen=True, eq=False)
class E57Header(Header):
    """What an E57 file says of the whole cloud."""

    scans: tuple[E57Scan, ...] = ()  # the attribute `scan` of a point is an index into them
    coordinate_metadata: str = ""  # the coordinate reference system, as well-known text

    @property
    def crs(self) -> str | None:
        """The coordinate reference system as well-known text; None if it is not known."""
        return self.coordinate_metadata or None

    def contents(self) -> list[str]:
        """Return in words the poses and names of the scans and the coordinate system, as far as they are known."""
        counts = (("pose", sum(scan.is_moved for scan in self.scans)), ("name", sum(bool(s.name) for s in self.scans)))
        scans = [f"the {what}s of {n} scans" if n > 1 else f"the {what} of 1 scan" for what, n in counts if n]
        return [*scans, *(["the coordinate system"] if self.coordinate_metadata else [])]


def read_e57(file: BufferedReader, rows: int, attributes: bool) -> Iterator[PointCloud]:
    """Read all scans of a file in chunks, each moved by its pose, without points that have no valid position."""
    with _scans(file) as (root, scans):
        crs = root["coordinateMetadata"].value() if root.isDefined("coordinateMetadata") else ""
        header = E57Header(tuple(source for scan in scans for source in scan.sources), crs)
        kept = _shared(scans) if attributes else {}
        for number, scan in enumerate(scans):
            with closing(scan.tables(kept, rows)) as tables:  # before the file is closed
                for columns in tables:
                    if attributes and len(scans) > 1:
                        columns["scan"] = np.full(len(columns["x"]), number, np.int32)
                    yield replace(cloud_of_columns(columns), header=header)


def unread_e57(file: BufferedReader) -> list[str]:
    """Return in words what `read_e57` leaves out: invalid points, fields that not all scans have, and images."""
    with _scans(file) as (root, scans):
        shared = _shared(scans)
        fields = {name for scan in scans for name in scan.names} - {*shared, *_CARTESIAN, *_SPHERICAL, *_STATES}
        invalid = sum(scan.count_invalid() for scan in scans)
        images = len(root["images2D"]) if root.isDefined("images2D") else 0
    return [
        *([f"points without a valid position ({invalid:,})"] if invalid else []),
        *(f"field {name}" for name in sorted(fields)),
        *([f"images ({images:,})"] if images else []),
    ]


def count_e57_points(file: BufferedReader) -> int:
    """Return how many points the scans of an E57 file have, those without a valid position included."""
    with _scans(file) as (_, scans):
        return sum(scan.count for scan in scans)


@contextmanager
def _scans(file: BufferedReader) -> Iterator[tuple[Any, list[_Scan]]]:
    """Open an E57 file: its root and its scans."""
    libe57 = require_libe57()
    _refuse_entities(file)
    size = os.fstat(file.fileno()).st_size
    errors = (libe57.E57Exception, RuntimeError, ValueError, TypeError, AttributeError, LookupError)
    with reported("libE57Format", "a whole E57 file", errors), _named(file) as path:
        image = libe57.ImageFile(path, "r")
        try:
            root = image.root()
            nodes = root["data3D"] if root.isDefined("data3D") else []
            scans = [_Scan(image, nodes[i], size) for i in range(len(nodes))]
            if not scans:
                raise FileFormatError("expected at least one scan, found none")
            yield root, scans
        finally:
            image.close()


def _refuse_entities(file: BufferedReader) -> None:
    """Raise an error if the XML part declares entities, which could grow to any size; E57 files have none."""
    header = file.read(_HEADER.size)
    if len(header) < _HEADER.size or not header.startswith(_SIGNATURE):
        raise FileFormatError("expected an E57 file, which begins with 'ASTM-E57', found another beginning")
    _, _, _, _, offset, length, page = _HEADER.unpack(header)
    if page != _PAGE or offset > (size := os.fstat(file.fileno()).st_size) or length > size:
        raise FileFormatError("expected a whole E57 file, found a header that does not fit it; get the file again")
    file.seek(offset - offset % page)
    pages = file.read(length + (length // (page - _CHECKSUM) + 2) * _CHECKSUM + 2 * page)
    xml = b"".join(pages[i : i + page - _CHECKSUM] for i in range(0, len(pages), page))
    if any(word in xml[offset % page :][:length] for word in (b"<!DOCTYPE", b"<!ENTITY", b"\0")):
        raise FileFormatError("expected XML without declarations in the E57 file, found some")


@contextmanager
def _named(file: BufferedReader) -> Iterator[str]:
    """Yield a path under which libE57Format can open a file."""
    name = file.name
    if isinstance(name, str | os.PathLike) and os.path.isfile(name):
        yield os.path.abspath(name)
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "cloud.e57")
        file.seek(0)
        with open(path, "wb") as copy:
            shutil.copyfileobj(file, copy)
        yield str(path)


class _Scan:
    """A scan of an open file."""

    def __init__(self, image: Any, node: Any, file_size: int) -> None:
        libe57 = require_libe57()
        self._image, self._node = image, node
        self._points = node["points"]
        prototype = libe57.StructureNode(self._points.prototype())
        self.names = _names_in(prototype)
        types = {name: _type_of_node(prototype[name]) for name in self.names}
        self.dtypes = {name: dtype for name, (dtype, _) in types.items() if dtype is not None}
        bits = sum(width for _, width in types.values())
        self.count = self._points.childCount()
        if self.count * max(bits, 1) > 8 * file_size:
            raise FileFormatError(
                f"expected a file that holds its {self.count:,} points, found one of {file_size:,} bytes; get it again"
            )
        systems = (_CARTESIAN, _SPHERICAL)
        self._axes = next((axes for axes in systems if all(axis in self.dtypes for axis in axes)), None)
        if self._axes is None:
            listed = ", ".join(map(repr, self.names)) or "nothing"
            raise FileFormatError(f"expected cartesian or spherical coordinates for each point, found {listed}")
        self._source = _source_of(node)

    @property
    def sources(self) -> list[E57Scan]:
        """The scan itself, or the scans that gppcs has written as this one."""
        if _SOURCES not in _names_in(self._node):  # isDefined refuses prefixes that the file has not
            return [self._source]
        nodes = self._node[_SOURCES]
        return [_source_of(nodes[i]) for i in range(len(nodes))]

    @property
    def _state(self) -> list[str]:
        """The field that tells whether a point has a position, if there is one."""
        return [name for name in [_STATES[self._axes is _SPHERICAL]] if name in self.dtypes]

    def count_invalid(self) -> int:
        """Return how many points have no position."""
        return sum(
            int(np.count_nonzero(values)) for block in self._blocks(self._state, BLOCK) for values in block.values()
        )

    def tables(self, fields: Mapping[str, np.dtype[Any]], rows: int) -> Generator[dict[str, Column], None, None]:
        """Yield coordinates and some of the fields, of certain types, of valid points."""
        assert self._axes is not None
        with closing(self._blocks([*self._state, *self._axes, *fields], rows)) as blocks:
            for block in blocks:
                yield self._table(block, fields)

    def _table(self, block: dict[str, Column], fields: Mapping[str, np.dtype[Any]]) -> dict[str, Column]:
        assert self._axes is not None
        for state in self._state:
            valid = block.pop(state) == 0
            block = {name: values[valid] for name, values in block.items()}
        coordinates = [block.pop(axis) for axis in self._axes]
        if self._axes is _SPHERICAL:
            distance, azimuth, elevation = coordinates
            level = distance * np.cos(elevation)
            coordinates = [level * np.cos(azimuth), level * np.sin(azimuth), distance * np.sin(elevation)]
        if self._source.is_moved:
            coordinates = list(self._source.moved(np.stack(coordinates, axis=1).astype(np.float64)).T)
        columns = dict(zip("xyz", coordinates, strict=True))
        for name, values in block.items():
            attribute = _NAMES.get(name, name.removeprefix(_PREFIX).replace(":", "_"))
            if attribute in columns:
                raise FileFormatError(f"expected fields of different names, found {attribute!r} twice")
            columns[attribute] = values.astype(fields[name], copy=False)
        return columns

    def _blocks(self, names: list[str], rows: int) -> Generator[dict[str, Column], None, None]:
        """Read fields of all points, block by block."""
        libe57 = require_libe57()
        if not (self.count and names):  # of which libE57Format makes no reader
            yield {name: np.empty(0, self.dtypes[name]) for name in names}
            return
        size = min(rows, BLOCK)
        blocks = {name: np.empty(size, _type_of_buffer(self.dtypes[name])) for name in names}
        buffers = libe57.VectorSourceDestBuffer()
        for name, block in blocks.items():
            buffers.append(libe57.SourceDestBuffer(self._image, name, block, size, True, True))
        reader = self._points.reader(buffers)
        try:
            done = 0
            while done < self.count and (length := reader.read()):
                yield {name: block[:length].astype(self.dtypes[name]) for name, block in blocks.items()}
                done += length
        finally:
            reader.close()
        if done < self.count:
            raise ends_early("point", done, self.count)


def _names_in(node: Any) -> list[str]:
    return [node.get(i).elementName() for i in range(node.childCount())]


def _type_of_node(node: Any) -> tuple[np.dtype[Any] | None, int]:
    """Return the type of a field's values, None if these are no numbers, and how many bits the file has for each."""
    libe57 = require_libe57()
    if isinstance(node, libe57.FloatNode):
        size = 4 if node.precision() == libe57.E57_SINGLE else 8
        return np.dtype(f"f{size}"), 8 * size
    if not isinstance(node, libe57.IntegerNode | libe57.ScaledIntegerNode):
        return None, 0
    low, high = node.minimum(), node.maximum()
    bits = (high - low).bit_length()
    if isinstance(node, libe57.ScaledIntegerNode):
        return np.dtype("f8"), bits
    kinds = _INTEGERS["u" if low >= 0 else "i"]
    return next(kind for kind in kinds if np.iinfo(kind).min <= low and high <= np.iinfo(kind).max), bits


def _type_of_buffer(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """Return the type in which pye57 can exchange values; of the larger integers, it takes only long long."""
    return np.dtype(np.longlong) if dtype.kind in "iu" and dtype.itemsize > 2 else dtype


def _source_of(node: Any) -> E57Scan:
    """Return identifier, name and pose of a scan."""
    texts: dict[str, Any] = {name: str(node[name].value()) for name in ("guid", "name") if node.isDefined(name)}
    pose: dict[str, Any] = {
        name: tuple(float(node[f"pose/{name}/{part}"].value()) for part in parts)
        for name, parts in _POSE.items()
        if node.isDefined(f"pose/{name}")
    }
    scan = replace(E57Scan(**texts), **pose)
    if not (np.isfinite([*scan.rotation, *scan.translation]).all() and any(scan.rotation)):
        raise FileFormatError(
            f"expected a pose of finite numbers with a rotation, found {scan.rotation} and {scan.translation}"
        )
    return scan


def _shared(scans: list[_Scan]) -> dict[str, np.dtype[Any]]:
    """Return the fields of numbers that all scans have, besides coordinates, with a type that holds those of all."""
    shared = {}
    for name in scans[0].dtypes:
        if name not in (*_CARTESIAN, *_SPHERICAL, *_STATES) and all(name in scan.dtypes for scan in scans):
            types = [scan.dtypes[name] for scan in scans]
            common = np.result_type(*types)
            whole = all(each.kind in "iu" for each in types)
            shared[name] = np.dtype(np.int64) if whole and common.kind == "f" else common  # E57 has no larger integers
    return shared


def write_e57(file: BinaryIO, cloud: PointCloud) -> None:
    """Write an E57 file of one scan, without a pose; other attributes become fields of an extension."""
    libe57 = require_libe57()
    columns = _columns(cloud)
    header = cloud.header if isinstance(cloud.header, E57Header) else E57Header()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "cloud.e57")
        try:
            image = libe57.ImageFile(str(path), "w")
            try:
                _write_image(image, columns, header)
            finally:
                image.close()
        except libe57.E57Exception as error:
            reason = str(error).partition("\n")[0]
            raise OutputError(
                f"expected to write an E57 file in {folder}, but libE57Format reports: {reason}"
            ) from error
        with open(path, "rb") as whole:
            shutil.copyfileobj(whole, file)


def _write_image(image: Any, columns: dict[str, Column], header: E57Header) -> None:
    libe57 = require_libe57()
    for prefix, uri in (("", libe57.E57_V1_0_URI), ("nor", _NORMALS), (_PREFIX.rstrip(":"), _OWN)):
        image.extensionsAdd(prefix, uri)
    digest = hashlib.blake2b(digest_size=16)
    for values in columns.values():
        digest.update(np.ascontiguousarray(values).data)
    guid = f"{{{uuid.UUID(bytes=digest.digest())}}}"  # of the content, so that the same cloud gives the same file
    scans, scan = libe57.VectorNode(image, True), libe57.StructureNode(image)
    about = {
        "formatName": "ASTM E57 3D Imaging Data File",
        "guid": guid,
        "versionMajor": libe57.E57_FORMAT_MAJOR,
        "versionMinor": libe57.E57_FORMAT_MINOR,
        "coordinateMetadata": header.coordinate_metadata,
        "data3D": scans,
        "images2D": libe57.VectorNode(image, True),
    }
    _fill(image, image.root(), about)
    scans.append(scan)
    _fill(image, scan, {"guid": guid})
    if header.scans:
        sources = libe57.VectorNode(image, True)
        scan.set(_SOURCES, sources)
        for each in header.scans:
            pose = {name: dict(zip(parts, getattr(each, name), strict=True)) for name, parts in _POSE.items()}
            sources.append(
                _fill(image, libe57.StructureNode(image), {"guid": each.guid, "name": each.name, "pose": pose})
            )
    _fill(image, scan, _limits(columns))
    _write_points(image, scan, columns)


def _fill(image: Any, node: Any, values: Mapping[str, Any]) -> Any:
    """Set texts, numbers, nodes and further values by name in a node, and return it."""
    libe57 = require_libe57()
    kinds = {str: libe57.StringNode, int: libe57.IntegerNode, float: libe57.FloatNode}
    for name, value in values.items():
        if isinstance(value, dict):
            value = _fill(image, libe57.StructureNode(image), value)
        node.set(name, kinds[type(value)](image, value) if type(value) in kinds else value)
    return node


def _limits(columns: dict[str, Column]) -> dict[str, dict[str, float]]:
    """Return between which values intensity and colours lie, by which other programs scale them."""
    found = dict[str, dict[str, float]]()
    for name, fields in (("intensity", ["intensity"]), ("color", ["colorRed", "colorGreen", "colorBlue"])):
        for field in fields if set(fields) <= columns.keys() else ():
            values = columns[field]
            finite = values[np.isfinite(values)] if name == "intensity" else np.array([0, np.iinfo(values.dtype).max])
            low, high = (finite.min().item(), finite.max().item()) if len(finite) else (0.0, 0.0)
            found.setdefault(f"{name}Limits", {}).update({f"{field}Minimum": low, f"{field}Maximum": high})
    return found


def _write_points(image: Any, scan: Any, columns: dict[str, Column]) -> None:
    libe57 = require_libe57()
    prototype = libe57.StructureNode(image)
    buffers = libe57.VectorSourceDestBuffer()
    blocks = {}
    for name, values in columns.items():
        if values.dtype.kind == "f":
            precision = libe57.E57_SINGLE if values.dtype.itemsize == 4 else libe57.E57_DOUBLE
            prototype.set(name, libe57.FloatNode(image, 0.0, precision))
        else:
            bounds = np.iinfo(values.dtype)
            prototype.set(name, libe57.IntegerNode(image, 0, int(bounds.min), min(int(bounds.max), _LARGEST)))
        blocks[name] = np.empty(BLOCK, _type_of_buffer(values.dtype))
        buffers.append(libe57.SourceDestBuffer(image, name, blocks[name], BLOCK, True, True))
    points = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
    scan.set("points", points)
    writer = points.writer(buffers)
    count = len(columns[_CARTESIAN[0]])
    for start in range(0, count, BLOCK):
        length = min(BLOCK, count - start)
        for name, values in columns.items():
            blocks[name][:length] = values[start : start + length]
        writer.write(length)
    writer.close()


def _columns(cloud: PointCloud) -> dict[str, Column]:
    """Return what is written of each point, by the name of its field."""
    found = columns_of(cloud)
    stored = {name: values.astype(exact_type(values, _STORED) or "f8", copy=False) for name, values in found.items()}
    attributes = {name: values for name, values in stored.items() if name not in "xyz"}
    coordinates = {field: stored[axis] for axis, field in zip("xyz", _CARTESIAN, strict=True)}
    return coordinates | {_field_of(name, attributes): values for name, values in attributes.items()}


def _field_of(name: str, attributes: dict[str, Column]) -> str:
    """Return the field that E57 has for an attribute, or one of the extension."""
    group = next((group for group in _TOGETHER if name in group), (name,))
    if name in _FIELDS and all(each in attributes for each in group):
        kinds = {"nx": "f", "red": "u", "row": "iu", "column": "iu"}.get(group[0], "iuf")
        if all(attributes[each].dtype.kind in kinds for each in group):
            return _FIELDS[name]
    return _PREFIX + name


def open_e57(file: BufferedReader) -> Reader:
    """Open an E57 file."""
    return Reader(
        partial(from_start, read_e57, file), count_e57_points(file), skipped=partial(from_start, unread_e57, file)
    )


def _stored(cloud: PointCloud) -> PointCloud:
    """Return a cloud as `write_e57` stores it."""
    require_libe57()  # before long work, not at its end
    return keeping(
        cloud,
        lambda name, values: (
            0 not in values.shape[1:]
            and exact_type(values, _STORED)
            and not (values.dtype.kind == "u" and values.size and values.max() > _LARGEST)
            and _ELEMENT.fullmatch(column_name(name))
        ),
        E57Header,
        plain_names=True,
    )


FORMAT = Format("E57", (".e57",), open_e57, write_e57, lambda start, size: start.startswith(_SIGNATURE), _stored)
