"""The k nearest points of many places: those of a leaf share a search, and vectors go through what it finds."""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.kdtree import LEAF_SIZE, leaves_near, nearest_in_tree, points_near

STRIDE = 16  # points that a loop goes through at a time: two of the widest vectors
FAR = 1e150  # a coordinate that is within no radius, and whose square is a number
MANY_LEAVES = 32  # with k more: a search that comes near so many leaves is left to each place
WIDER = 2.5  # times the mean squared distance to the k-th neighbour in one leaf are looked at in the next
TRIALS = 24  # of a radius that holds just k


class Room(NamedTuple):
    """Room for the positions of points found, and their coordinates, an axis a row."""

    found: NDArray[np.int64]
    packed: NDArray[np.float64]


@nb.njit(cache=True)
def room_for(leaves):
    """Return room for the points of so many leaves."""
    return Room(
        np.empty(leaves * LEAF_SIZE, dtype=np.int64), np.empty((3, leaves * LEAF_SIZE + STRIDE), dtype=np.float64)
    )


@nb.njit(cache=True)
def pack(points, room, count):
    """Copy the coordinates of the points found together, add far ones until vectors are full; return their number."""
    full = -(-count // STRIDE) * STRIDE
    for axis in range(3):
        row, packed = points[axis], room.packed[axis]
        for slot in range(count):
            packed[slot] = row[room.found[slot]]
        packed[count:full] = FAR
    return full


class Search(NamedTuple):
    """Room for a search of the k nearest points of each place of a leaf.

    Attributes
    ----------
    near : (leaves,) array, int64
        Leaves that the search comes near.
    room : Room
        What it finds there.
    squared : array
        Squared distances of these from a place.
    positions, gaps : (k,) arrays
        Positions and squared distances of the nearest, where a place searches by itself.
    local : (3, k or a little more) array
        The steps from a place to its k nearest points, then far ones.
    """

    near: NDArray[np.int64]
    room: Room
    squared: NDArray[np.float64]
    positions: NDArray[np.int64]
    gaps: NDArray[np.float64]
    local: NDArray[np.float64]


@nb.njit(cache=True)
def search_for(k, leaves):
    """Return room for searches of k points of a tree with so many leaves."""
    most = min(MANY_LEAVES + k, leaves + 1)
    room = room_for(most)
    return Search(
        np.empty(most, dtype=np.int64), room, np.empty(room.packed.shape[1], dtype=np.float64),
        np.empty(k, dtype=np.int64), np.empty(k, dtype=np.float64), np.full((3, -(-k // STRIDE) * STRIDE), FAR),
    )  # fmt: skip


@nb.njit(cache=True)
def look_around(points, low, high, box_low, box_high, squared_radius, search):
    """Pack the points within the radius of a box, none if there are too many; return their number, far ones counted."""
    count = leaves_near(low, high, box_low, box_high, squared_radius, search.near)
    if count == len(search.near):
        return 0
    near = search.near[:count]
    count = points_near(points, low, high, near, box_low, box_high, squared_radius, search.room.found)
    return pack(points, search.room, count)


@nb.njit(cache=True, fastmath=False)
def steps_to_nearest(points, low, high, x, y, z, count, squared_radius, search):
    """Fill `search.local` with the steps from (x, y, z) to its k nearest points; return the k-th squared distance."""
    k, packed, found = len(search.gaps), search.room.packed, search.room.found
    reach = reach_of_nearest(packed, count, x, y, z, k, squared_radius, search.squared)
    if reach < 0.0:
        return steps_by_itself(points, low, high, x, y, z, search)
    slot = 0
    for j in range(count):
        found[slot] = j  # within reach or not: a branch would be guessed wrong too often
        slot += 1 if search.squared[j] <= reach else 0
    farthest = 0.0
    for slot in range(k):
        j = found[slot]
        search.local[0, slot], search.local[1, slot] = packed[0, j] - x, packed[1, j] - y
        search.local[2, slot] = packed[2, j] - z
        farthest = max(farthest, search.squared[j])
    return farthest


@nb.njit(cache=True, fastmath=False)
def steps_by_itself(points, low, high, x, y, z, search):
    """Do the same as `steps_to_nearest` by a search of the tree, for a place that a leaf's search does not do for."""
    nearest_in_tree(points, low, high, x, y, z, search.positions, search.gaps)
    for slot in range(len(search.gaps)):
        j = search.positions[slot]
        search.local[0, slot], search.local[1, slot] = points[0, j] - x, points[1, j] - y
        search.local[2, slot] = points[2, j] - z
    return search.gaps[-1]


@nb.njit(cache=True, fastmath={"nsz", "arcp", "contract", "reassoc"})
def reach_of_nearest(packed, count, x, y, z, k, squared_radius, squared):
    """Return a squared distance from (x, y, z) within which just k of the packed points lie; their own into `squared`.

    That is -1 if the radius does not hold k, or ties leave no ball with just k. By regula falsi: on a surface the
    number of points within a distance goes about as its square.
    """
    along_x, along_y, along_z = packed[0][:count], packed[1][:count], packed[2][:count]
    squared = squared[:count]
    for j in range(len(along_x)):
        dx, dy, dz = along_x[j] - x, along_y[j] - y, along_z[j] - z
        squared[j] = dx * dx + dy * dy + dz * dz
    low, high = 0.0, squared_radius
    below, above = 0.0, _within(squared, high)
    for _ in range(TRIALS):
        if above < k:
            break
        if above == k:
            return high
        middle = low + (high - low) * (k - below) / (above - below)
        inside = _within(squared, middle)
        if inside == k:
            return middle
        if inside < k:
            low, below = middle, inside
        else:
            high, above = middle, inside
    return -1.0


@nb.njit(cache=True, fastmath={"nsz", "arcp", "contract", "reassoc"})
def _within(squared, limit):
    count = 0.0
    for j in range(len(squared)):
        count += 1.0 if squared[j] <= limit else 0.0
    return count
