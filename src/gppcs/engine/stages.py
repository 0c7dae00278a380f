"""The stages of a run: how long each took, and word of their progress to whoever listens."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter
from typing import Protocol


class Listener(Protocol):
    """Hears of the stages of a run, for instance to draw a progress bar."""

    def started(self, stage: str, total: int | None) -> None:
        """Hear that a stage began; `total` is its number of steps, None where that is not known."""

    def advanced(self, steps: int) -> None:
        """Hear that the current stage has done so many more steps."""

    def finished(self) -> None:
        """Hear that the current stage is over."""


class Stages:
    """Times the stages of one run, by name, in `seconds`; a name that occurs again adds up."""

    def __init__(self, listener: Listener | None = None) -> None:
        self.seconds: dict[str, float] = {}
        self._listener = listener

    def anew(self) -> Stages:
        """Return stages with the same listener that have taken no time yet."""
        return Stages(self._listener)

    @contextmanager
    def __call__(self, name: str, total: int | None = None) -> Iterator[Callable[[int], None]]:
        """Run a block as a stage; what is yielded takes the number of steps done since the last call."""
        listener = self._listener
        if listener:
            listener.started(name, total)
        start = perf_counter()
        try:
            yield listener.advanced if listener else _ignore
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + perf_counter() - start
            if listener:
                listener.finished()


def _ignore(steps: int) -> None:
    pass
