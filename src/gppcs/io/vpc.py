"""Reads virtual point clouds (VPC): lists of files, kept as STAC items in GeoJSON."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from gppcs.errors import FileFormatError

SUFFIX = ".vpc"


def files_of(path: Path) -> list[Path]:
    """Return the files that a path stands for: itself, or the files that a virtual point cloud lists, in its order."""
    if path.suffix.lower() != SUFFIX:
        return [path]
    try:
        content = json.loads(path.read_bytes())
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
    if not isinstance(name, str) or not name or "\0" in name:
        raise FileFormatError(f"{path}: expected the name of a file as asset 'data' of feature {number}, found none")
    scheme = re.match(r"(\w[\w+.-]+)://", name)
    if scheme and scheme[1] != "file":
        raise FileFormatError(f"{path}: expected files of this machine, found {name}; get them first, and the list")
    from urllib.request import url2pathname  # it loads ssl, which takes longer than all else here

    return Path(url2pathname(urlsplit(name).path)) if scheme else path.parent / name
