"""What formats leave out and hold."""

import struct
from collections import namedtuple

from gppcs.io import FORMATS, CloudFiles, format_to_write

WRITABLE = [file_format.suffixes[0] for file_format in FORMATS if file_format.write]
Loaded = namedtuple("Loaded", "cloud faces unread")


def losses(path, cloud):
    """In words, what a file would not hold of a cloud."""
    fit = format_to_write(path).fit(cloud)
    return [*fit.values, *fit.remarks]


def load(path):
    """A cloud, its number of faces, and in words what is not read."""
    with CloudFiles([path]) as files:
        return Loaded(files.read(), files.n_faces, files.skipped())


def overwrite(path, place, values):
    """Put other bytes at a place of a file."""
    with open(path, "r+b") as file:
        file.seek(place)
        file.write(bytes(values))


def lzf(data):
    """Data as LZF holds it without compression: in runs of at most 32 bytes, behind their length less one."""
    runs = (data[i : i + 32] for i in range(0, len(data), 32))
    return b"".join(bytes([len(run) - 1]) + run for run in runs)


def glb(text, numbers=b""):
    """A binary glTF file of a description in JSON and the bytes of its buffer."""
    chunks = [(b"JSON", text + b" " * (-len(text) % 4)), (b"BIN\0", numbers + b"\0" * (-len(numbers) % 4))]
    body = b"".join(struct.pack("<I", len(content)) + name + content for name, content in chunks)
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def parts_of_glb(data):
    """The description and the bytes of the buffer of a binary glTF file."""
    end = 20 + int.from_bytes(data[12:16], "little")
    return data[20:end], data[end + 8 :]


def compressed_pcd(points):
    """A PCD file of float32 coordinates in the encoding with compression."""
    data = points.astype("<f4").T.tobytes()
    packed, n = lzf(data), len(points)
    head = f"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {n}\nHEIGHT 1\nPOINTS {n}\n"
    return head.encode() + b"DATA binary_compressed\n" + struct.pack("<II", len(packed), len(data)) + packed
