"""Reads and writes point cloud files."""

from gppcs.io.cloud_files import CloudFiles
from gppcs.io.files import FORMATS, format_to_write
from gppcs.io.format import Format
from gppcs.io.las import to_laspy
from gppcs.io.reading import as_cloud, read
from gppcs.io.streams import check_distinct, check_writable, inner_name, is_standard, whole_output
from gppcs.io.vpc import files_of
from gppcs.io.writing import check_storable, store, store_in, write

__all__ = [
    "FORMATS",
    "CloudFiles",
    "Format",
    "as_cloud",
    "check_distinct",
    "check_storable",
    "check_writable",
    "files_of",
    "format_to_write",
    "inner_name",
    "is_standard",
    "read",
    "store",
    "store_in",
    "to_laspy",
    "whole_output",
    "write",
]
