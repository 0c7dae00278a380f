"""Reads and writes point cloud files."""

from gppcs.io.files import FORMATS, check_losses, format_to_write, losses, read, unread, write
from gppcs.io.format import Format
from gppcs.io.whole_file import check_distinct, check_writable, whole_file

__all__ = [
    "FORMATS",
    "Format",
    "check_distinct",
    "check_losses",
    "check_writable",
    "format_to_write",
    "losses",
    "read",
    "unread",
    "whole_file",
    "write",
]
