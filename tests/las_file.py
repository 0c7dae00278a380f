"""LAS files with random bytes in every dimension."""

from datetime import date

import laspy
import numpy as np
from laspy.vlrs.known import WktCoordinateSystemVlr
from laspy.vlrs.vlrlist import VLRList

EXTRA_TYPES = [
    f"{width}{kind}"
    for width in ("", "2", "3")
    for kind in ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8")
]
WKT = 'PROJCS["NAD83 / Oregon",GEOGCS["NAD83",AUTHORITY["EPSG","4269"]],UNIT["foot",0.3048],AUTHORITY["EPSG","2991"]]'


def random_las(version, number, n=300, extra=(*EXTRA_TYPES, "100u1")):
    """Points of a version and point format, with random bytes in every dimension, and a header full of things."""
    rng = np.random.default_rng(number)
    header = laspy.LasHeader(version=version, point_format=number)
    header.scales, header.offsets = [0.001, 0.01, 0.0001], [500_000, 5e6, -3]
    header.add_extra_dims([laspy.ExtraBytesParams(f"extra {i}", kind) for i, kind in enumerate(extra)])
    header.add_extra_dim(laspy.ExtraBytesParams("scaled", "i4", scales=[0.5], offsets=[7.0], description="some"))
    header.vlrs.append(laspy.VLR("somebody", 77, "anything", bytes(range(256))))
    header.vlrs.append(WktCoordinateSystemVlr(WKT))
    header.creation_date, header.file_source_id, header.system_identifier = date(2001, 2, 3), 3, "A SCANNER"
    header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    las = laspy.LasData(header)
    record = las.points.array = np.zeros(n, header.point_format.dtype())
    record[:] = np.frombuffer(rng.bytes(record.nbytes), record.dtype)
    if version == "1.4":
        las.evlrs = VLRList([laspy.VLR("somebody", 78, "later", b"much" * 20_000)])
    return las


def las_of(points, point_format=6, scales=(0.01,) * 3, offsets=(0,) * 3, **dimensions):
    """Points, (N, 3), and other dimensions as laspy holds them."""
    header = laspy.LasHeader(point_format=point_format, version="1.4" if point_format > 5 else "1.2")
    header.scales, header.offsets = scales, offsets
    las = laspy.LasData(header)
    las.xyz = points
    for name, values in dimensions.items():
        las[name] = values
    return las


def save(las, path):
    with np.errstate(all="ignore"):  # random floats may be NaN, of which laspy computes minima
        las.write(path)
    return path
