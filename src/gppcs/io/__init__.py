"""Reads and writes point cloud files."""

from gppcs.io.files import FORMATS, check_storable, format_to_write, losses, store, write
from gppcs.io.format import Format
from gppcs.io.las import to_laspy
from gppcs.io.reading import as_cloud, load, read, read_each
from gppcs.io.streams import COMPRESSIONS, inner_name, whole_output
from gppcs.io.vpc import SUFFIX as VPC
from gppcs.io.vpc import files_of
from gppcs.io.whole_file import check_distinct, check_writable, is_standard, whole_file

__all__ = [
    "COMPRESSIONS",
    "FORMATS",
    "VPC",
    "Format",
    "as_cloud",
    "check_distinct",
    "check_storable",
    "check_writable",
    "files_of",
    "format_to_write",
    "inner_name",
    "is_standard",
    "load",
    "losses",
    "read",
    "read_each",
    "store",
    "to_laspy",
    "whole_file",
    "whole_output",
    "write",
]
