"""Writes the page: one HTML file that holds the viewer and all data, and needs no network."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, BinaryIO

import numpy as np

from gppcs.drawing.viewpoint import Viewpoint
from gppcs.drawing.web.layers import Layer
from gppcs.drawing.web.packing import Blocks
from gppcs.engine.strict_json import strict_json
from gppcs.evaluation.report import Report, figures_of

PLACE = b"<!--DATA-->"  # in the page that `make viewer` builds
APART = 2.0  # clouds are drawn in one frame unless their common box is larger than the largest by this factor,
SMALL = 0.1  # or one is smaller than this share of the largest


@dataclass(frozen=True)
class Page:
    """A page of clouds."""

    title: str
    lead: str
    layers: Sequence[Layer]
    blocks: Blocks
    viewpoint: Viewpoint
    made: Sequence[tuple[str, str]]
    notes: Sequence[str] = ()
    diagonal: float = 0.0
    lengths: str = ""

    @property
    def all_notes(self) -> list[str]:
        """What the page says first: its own notes, those of its layers, and that the clouds do not lie together."""
        notes = [*self.notes, *(note for layer in self.layers for note in layer.notes)]
        if not _lie_together(self.layers):
            notes.append("The clouds lie far apart or differ much in size, so each view has a frame of its own.")
        return notes

    def write(self, file: BinaryIO) -> None:
        """Write the page."""
        before, after = _viewer().split(PLACE)
        file.write(before)
        file.write(_script("description", "application/json", _json(self._description())))
        for number, text in enumerate(self.blocks.texts):
            file.write(_script(f"block{number}", "text/plain", text))
        file.write(after)

    def _description(self) -> dict[str, Any]:
        """Return all that the page says, and where its arrays are."""
        viewpoint = self.viewpoint.completed(self.layers[0].cloud.points)
        assert viewpoint.direction
        return {
            "title": self.title,
            "lead": self.lead,
            "notes": self.all_notes,
            "up": viewpoint.up,
            "azimuth": viewpoint.direction[0],
            "elevation": viewpoint.direction[1],
            "together": _lie_together(self.layers),
            "diagonal": self.diagonal,
            "lengths": self.lengths,
            "clouds": [layer.described for layer in self.layers],
            "figures": [
                {
                    "name": name,
                    "title": name.replace("_", " "),
                    "unit": figure.unit,
                    "definition": figure.definition,
                    "better": figure.better,
                }
                for name, figure in figures_of(Report).items()
            ],
            "made": list(self.made),
        }


def _viewer() -> bytes:
    """Return the page without data."""
    return (files("gppcs.drawing.web") / "page.html").read_bytes()


def _script(name: str, kind: str, text: str) -> bytes:
    """Return an element that holds data. The text must not hold markup."""
    return f'<script id="{name}" type="{kind}">{text}</script>\n'.encode("ascii")


def _json(value: Any) -> str:
    """Return strict JSON in ASCII without the characters that end an element."""
    return strict_json(value).replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _lie_together(layers: Sequence[Layer]) -> bool:
    """Return whether clouds can be drawn in one frame."""
    boxes = np.array([(layer.cloud.points.min(axis=0), layer.cloud.points.max(axis=0)) for layer in layers])
    with np.errstate(over="ignore"):
        sizes = np.linalg.norm(boxes[:, 1] - boxes[:, 0], axis=1)
        whole = np.linalg.norm(boxes[:, 1].max(axis=0) - boxes[:, 0].min(axis=0))
    return bool(whole <= APART * sizes.max() and sizes.min() >= SMALL * sizes.max())
