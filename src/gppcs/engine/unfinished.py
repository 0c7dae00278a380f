"""Temporary files and folders that never stay behind."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress


@contextmanager
def unfinished(path: str) -> Iterator[None]:
    """Remove a temporary file or folder at the end of the block, if it is still there."""
    try:
        yield
    finally:
        if os.path.isdir(path):
            shutil.rmtree(path, ignore_errors=True)
        else:
            with suppress(FileNotFoundError):
                os.unlink(path)
