"""Reads virtual point clouds (VPC): lists of files, kept as STAC items in GeoJSON."""

import json
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gppcs.errors import FileFormatError, file_path
from gppcs.io.remote import address_of, open_remote

SUFFIX = ".vpc"


def files_of(path: Path) -> list[Path]:
    """Return the files that a path stands for: itself, or the files that a virtual point cloud lists, in its order."""
    if path.suffix.lower() != SUFFIX:
        return [path]
    try:
        with open_remote(address) if (address := address_of(path)) else path.open("rb") as file:
            content = json.loads(file.read())
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"{path}: expected a virtual point cloud in GeoJSON, but {error}") from error
    features = content.get("features") if isinstance(content, dict) else None
    if not isinstance(features, list) or not features:
        raise FileFormatError(f"{path}: expected a virtual point cloud with features, one for each file, found none")
    return [_file_of(path, feature, number) for number, feature in enumerate(features, 1)]


def _file_of(path: Path, feature: Any, number: int) -> Path:
    """Return the file of a feature; its other assets, such as an overview, are left out."""
    try:
        assets = feature["assets"]
        data = assets["data"] if "data" in assets else next(a for a in assets.values() if "data" in a["roles"])
        name = data["href"]
    except (LookupError, TypeError, AttributeError, StopIteration):
        name = None
    if not isinstance(name, str) or not name:
        raise FileFormatError(f"{path}: expected the name of a file as asset 'data' of feature {number}, found none")
    if address_of(Path(name)):
        return file_path(name)
    file = _local_name(name)
    if file is None or "\0" in file:
        raise FileFormatError(f"{path}: expected addresses, or files of this machine, found {name!r}; get them first")
    return file_path(os.path.join(path.parent, file))  # where it is "-", that is no standard input


def _local_name(name: str) -> str | None:
    """Return the name of a file that a name or a URL stands for; None if it is that of another machine."""
    url = re.match(r"([a-z][\w+.-]+):(?=/)(?://(?P<host>[^/?#]*))?(?P<path>[^?#]*)", name, re.IGNORECASE | re.ASCII)
    if url:
        from urllib.request import url2pathname  # it loads ssl, which takes longer than all else here

        is_local = url[1].lower() == "file" and (url["host"] or "").lower() in ("", "localhost")
        if not is_local or url["path"][:2] in ("", "//"):
            return None
        name = url2pathname(url["path"])
    return None if name[:2].replace("\\", "/") == "//" else name  # which Windows would fetch from a host


def vpc_of(files: Sequence[tuple[str, int, list[float], list[float]]]) -> str:
    """Return a virtual point cloud of files beside it: their names, numbers of points, and corners of boxes."""
    features = []
    for name, n_points, lower, upper in files:
        box = lower + upper  # in the coordinate system of the file
        x, y, _, to_x, to_y, _ = box
        feature = {
            "type": "Feature",
            "stac_version": "1.0.0",
            "stac_extensions": ["https://stac-extensions.github.io/pointcloud/v1.0.0/schema.json"],
            "id": Path(name).stem,
            "geometry": {"type": "Polygon", "coordinates": [[[x, y], [to_x, y], [to_x, to_y], [x, to_y], [x, y]]]},
            "bbox": box,
            "properties": {"datetime": None, "pc:count": n_points, "pc:type": "lidar", "proj:bbox": box},
            "links": [],
            "assets": {"data": {"href": f"./{name}", "roles": ["data"]}},
        }
        features += [feature] if n_points else []
    return json.dumps({"type": "FeatureCollection", "features": features}, indent=1)
