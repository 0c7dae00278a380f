"""Steps of long work that are done once, also if the work is interrupted and begun again."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

Result = TypeVar("Result")


class Journal:
    """The results of the steps that are done, in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def once(self, step: str, work: Callable[[], Result]) -> Result:
        """Do a step, unless it has been done."""
        path = self._folder / f"{step}.done"
        if path.exists():
            with suppress(EOFError, pickle.UnpicklingError):  # a machine that stopped may leave an incomplete file
                result: Result = pickle.loads(path.read_bytes())
                return result
        result = work()
        unfinished = path.with_suffix(".part")
        unfinished.write_bytes(pickle.dumps(result, protocol=pickle.HIGHEST_PROTOCOL))
        os.replace(unfinished, path)
        return result
