"""Reads and writes point cloud files."""

from gppcs.io.files import FORMATS, format_to_write, left_out, read, unwritten, write
from gppcs.io.format import Format
from gppcs.io.whole_file import check_distinct, check_writable, whole_file

__all__ = [
    "FORMATS",
    "Format",
    "check_distinct",
    "check_writable",
    "format_to_write",
    "left_out",
    "read",
    "unwritten",
    "whole_file",
    "write",
]
