"""Writes COPC files, which laspy only reads."""

import laspy
import lazrs
import numpy as np

ENTRY = np.dtype([("level", "<i4"), ("cell", "<i4", 3), ("offset", "<u8"), ("size", "<i4"), ("count", "<i4")])


def write_copc(path, las, depth, spacing, paged=False):
    """Write points of LAS 1.4 as an octree of a number of levels, whose index has one page, or several if `paged`.

    Return the entries of the index. Point i is on a level that a hash of i gives.
    """
    points = np.column_stack([las.x, las.y, las.z])
    low = points.min(axis=0)
    halfsize = np.ptp(points, axis=0).max() / 2 * 1.001
    level = np.minimum(np.log2(1 + np.arange(len(points)) * 7919 % 8**depth).astype(int) // 3, depth - 1)
    cell = ((points - low) * (2.0**level / (2 * halfsize))[:, np.newaxis]).astype(int)
    keys, where = np.unique(np.column_stack([level, cell]), axis=0, return_inverse=True)

    kind = lazrs.LazVlr.new_for_compression(las.header.point_format.id, 0, use_variable_size_chunks=True)
    empty = laspy.LasData(laspy.LasHeader(point_format=las.header.point_format.id, version="1.4"))
    empty.header.scales, empty.header.offsets = las.header.scales, las.header.offsets
    empty.header.vlrs.append(laspy.VLR("copc", 1, "copc info", bytes(160)))
    empty.header.vlrs.append(laspy.VLR("laszip encoded", 22204, "lazrs", bytes(kind.record_data())))
    with open(path, "w+b") as file:
        with laspy.open(file, "w", header=empty.header, do_compress=False, closefd=False):
            pass
        start = file.seek(0, 2)
        compressor = lazrs.LasZipCompressor(file, kind)
        for i in range(len(keys)):
            if i:
                compressor.finish_current_chunk()
            compressor.compress_many(las.points.array[where.ravel() == i].view(np.uint8))
        compressor.done()
        file.seek(start)
        sizes = [size for _, size in lazrs.read_chunk_table(file, kind)]
        index = np.zeros(len(keys), ENTRY)
        index["level"], index["cell"] = keys[:, 0], keys[:, 1:]
        index["size"], index["count"] = sizes, np.bincount(where.ravel())
        index["offset"] = start + 8 + np.cumsum([0, *sizes[:-1]])
        root = _write_index(file, index, paged)
        _write_at(file, 104, np.uint8(las.header.point_format.id | 0x80))
        _write_at(file, 247, np.uint64(len(points)))
        bounds = np.column_stack([points.max(axis=0), low])
        _write_at(file, 179, bounds)
        info = np.array([*(low + halfsize), halfsize, spacing])
        _write_at(file, 375 + 54, info, np.array(root, "<u8"))
    return index


def _write_index(file, index, paged):
    """Write the index behind the points, each branch below the root on a page of its own if wanted.

    Return the position and length of the first page.
    """
    branches = index["cell"] >> np.maximum(index["level"] - 1, 0)[:, np.newaxis]
    branches[index["level"] == 0] = -1
    first = index[index["level"] == 0] if paged else index
    for cell in np.unique(branches[branches[:, 0] >= 0], axis=0) if paged else ():
        page = index[(branches == cell).all(axis=1)]
        link = np.array([(1, cell, file.seek(0, 2), page.nbytes, -1)], ENTRY)
        file.write(page.tobytes())
        first = np.concatenate([first, link])
    position = file.seek(0, 2)
    file.write(first.tobytes())
    return position, first.nbytes


def _write_at(file, position, *values):
    file.seek(position)
    for value in values:
        file.write(np.ascontiguousarray(value).tobytes())
