"""Scenes that a depth camera, a moving LiDAR and an aeroplane measure."""

from gppcs.scans.scenes.room import ROOM
from gppcs.scans.scenes.scene import Scene
from gppcs.scans.scenes.street import STREET
from gppcs.scans.scenes.terrain import TERRAIN

__all__ = ["SCENES", "Scene"]

SCENES: dict[str, Scene] = {"room": ROOM, "street": STREET, "terrain": TERRAIN}
