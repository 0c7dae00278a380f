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
    """The results of the steps that are done, in a folder.

    Parameters
    ----------
    folder : path
        An existing folder of this user alone: results are read by pickle.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def once(self, step: str, work: Callable[[], Result]) -> Result:
        """Do a step, unless it has been done.

        Parameters
        ----------
        step : str
            Its name, which is that of a file.
        work : callable
            Does the step. What an interrupted step has left must not disturb it.

        Returns
        -------
        object
            The result of the step, now or then.
        """
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
