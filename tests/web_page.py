"""Reads pages of `gppcs report` and `gppcs view`, as the script in the page does."""

import base64
import json
import re
import zlib

import numpy as np


class WebPage:
    """The data in a page: `described` is what it says."""

    def __init__(self, text):
        self.text = text
        self.described = json.loads(self._element("description"))

    def _element(self, name):
        (content,) = re.findall(rf'<script id="{name}" type="[a-z/]+">(.*?)</script>', self.text, re.DOTALL)
        return content

    def array(self, block, rows, columns, kind):
        return unpacked(self._element(block), rows, columns, kind)

    def points(self, cloud):
        """Return the coordinates of a cloud of the description."""
        numbers = self.array(cloud["blocks"]["positions"], cloud["shown"], 3, np.uint16)
        return np.array(cloud["low"]) + np.array(cloud["step"]) * numbers

    def triangles(self, mesh):
        """Return the corners of a mesh of the description, (F, 3, 3)."""
        places = self.array(mesh["blocks"]["positions"], mesh["vertices"], 3, np.uint16) * mesh["step"] + mesh["low"]
        return places[faces_of(self.array(mesh["blocks"]["faces"], mesh["triangles"], 3, np.uint32))]

    def values(self, cloud, key):
        """Return the values of a cloud that colours can show, and half of the step in which they are held."""
        (held,) = (values for values in cloud["values"] if values["key"] == key)
        numbers = self.array(held["block"], cloud["shown"], 1, np.uint16)[:, 0]
        if held["categories"]:
            return np.array(held["categories"])[numbers], 0.0
        values = held["low"] + held["step"] * numbers.astype(float)
        return np.where(numbers == 65535, np.nan, values), held["step"] / 2


def unpacked(text, rows, columns, kind):
    """Return an array, (rows, columns), from a block of the page."""
    width = np.dtype(kind).itemsize
    planes = np.frombuffer(zlib.decompress(base64.b64decode(text)), dtype=np.uint8).reshape(columns, width, rows)
    differences = sum(planes[:, byte].astype(np.uint64) << np.uint64(8 * byte) for byte in range(width))
    return differences.cumsum(axis=1).astype(kind).T


def faces_of(packed):
    """Return triangles from what `packed_faces` made of them."""
    steps = np.diff(packed[:, 1:], axis=0, prepend=np.uint32(0))  # modulo 2**32
    return np.column_stack([packed[:, 0], packed[:, :1] + steps])


class ServedNode:
    """The points of a node, (n, 3), with their rows in the file, as the script in the page reads what is served."""

    def __init__(self, cloud, number, content):
        octree = cloud["octree"]
        self.level, *self.cell, n, row = octree["nodes"][number]
        self.rows, self._content, self._place = row + np.arange(n), content, 0
        *low, self.spacing = self._next("<f8", 4)
        whole = np.array(low) + self._next("<u4", 3 * n).reshape(n, 3)
        self.points = whole * np.array(octree["scales"]) + np.array(octree["offsets"])
        self._numbers = {values["key"]: (values, self._next("<u2", n)) for values in cloud["values"]}
        self.normals, self.spreads = self._next("u1", 2 * n).reshape(n, 2), self._next("u1", n)
        self.colours = self._next("u1", 3 * n if "colours" in cloud["blocks"] else 0).reshape(-1, 3)
        assert self._place == len(content)

    def _next(self, kind, n):
        array = np.frombuffer(self._content, kind, n, self._place)
        self._place += array.nbytes
        return array

    def values(self, key):
        """Return the values by which colours can be, NaN for unknown ones."""
        held, numbers = self._numbers[key]
        if held["categories"]:
            return np.array([*held["categories"], np.nan])[np.minimum(numbers, len(held["categories"]))]
        return np.where(numbers == 65535, np.nan, held["low"] + held["step"] * numbers.astype(float))
