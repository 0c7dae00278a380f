"""The sample scans of gppcs, and others for benchmarks and tests: more objects, and scenes that a sensor measures.

The objects are about 100 mm long. "painted" is the statue with colours. The horn, the cable, the handlebar and the
funnel are tubes, the vents, the crate, the sink, the organizer and the louvre ribbed cases, with both sheets of a wall
near each other; no constant of gppcs was decided by the funnel, the organizer and the louvre. The scenes are what a
sensor sees from its place, with its noise and with shadows, in the order of its measurements: a room (4 m, by a depth
camera), an avenue (60 m, by a LiDAR on a car), a terrain (120 m, from the air), and a wooded slope (50 m), as a
"forest" from a drone and as a "plot" from two tripods on the ground. Their normals point to the sensor, those of leaves
are zero. They have `classification`, of which 64 is everything that the LAS specification does not name, and no
`curvature`.
"""

from __future__ import annotations

from typing import Any

import gppcs
import gppcs.scans
from gppcs.scans.patch import Scan
from scans.avenue import AVENUE
from scans.case import CASE
from scans.gears import GEARS
from scans.horse import HORSE
from scans.moth import MOTH
from scans.plant import PLANT
from scans.plate import PLATE
from scans.ribs import CRATE, LOUVRE, ORGANIZER, SINK, VENTS
from scans.room import ROOM
from scans.scene import Scene
from scans.statue import PAINTED, STATUE
from scans.terrain import TERRAIN
from scans.tubes import CABLE, FUNNEL, HANDLEBAR, HORN
from scans.wood import FOREST, PLOT

OBJECTS: dict[str, Scan] = {
    "statue": STATUE, "painted": PAINTED, "horse": HORSE, "moth": MOTH, "case": CASE, "plate": PLATE, "gears": GEARS,
    "plant": PLANT, "horn": HORN, "cable": CABLE, "handlebar": HANDLEBAR, "vents": VENTS, "crate": CRATE, "sink": SINK,
    "funnel": FUNNEL, "organizer": ORGANIZER, "louvre": LOUVRE,
}  # fmt: skip
SCENES: dict[str, Scene] = {
    "room": ROOM, "avenue": AVENUE, "terrain": TERRAIN, "forest": FOREST, "plot": PLOT,
}  # fmt: skip
SCANS: dict[str, Scan] = {**gppcs.scans.SCANS, **OBJECTS}


def sample(name: str, n_points: int = 200_000, **options: Any) -> gppcs.PointCloud:
    """Return a sample scan, as `gppcs.sample` does."""
    return gppcs.scans.measure({**SCANS, **SCENES}[name], n_points, **options)
