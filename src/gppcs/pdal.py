"""gppcs in a pipeline of PDAL, by its stage `filters.python`."""

import re
from collections.abc import Mapping, MutableMapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

import gppcs

NAMES = {"scan_channel": "scanner_channel", "infrared": "nir"}  # as LAS files name dimensions, where PDAL does not


def simplify(ins: Mapping[str, NDArray[Any]], outs: MutableMapping[str, NDArray[Any]], **options: Any) -> bool:
    """Mark the points of a view of PDAL that are kept. All dimensions stay as they are.

    Parameters
    ----------
    ins : mapping of str to (N,) array
        The dimensions, with at least X, Y and Z.
    outs : mapping
        Gets "Mask", (N,) of type bool, by which PDAL drops points. A view without points gets one of no rows.
    **options
        As for `gppcs.simplify`, such as `ratio=0.1`, but neither normals nor scores: PDAL takes no other dimensions
        beside a mask. Attributes have the names that LAS files give them, such as "gps_time", or "rgb" for the colours.

    Returns
    -------
    bool
        True: the stage has succeeded.

    Raises
    ------
    InputError, ParameterError
        As for `gppcs.simplify`, and if the method moves points.

    Examples
    --------
    >>> import numpy as np
    >>> import gppcs.pdal
    >>> ins = dict(zip("XYZ", np.random.default_rng(0).random((3, 1000)), strict=True))
    >>> outs = {}
    >>> gppcs.pdal.simplify(ins, outs, n_points=50)
    True
    >>> int(outs["Mask"].sum())
    50
    """
    points = np.column_stack([ins[axis] for axis in "XYZ"])
    mask = outs["Mask"] = np.zeros(len(points), dtype=np.bool_)
    if options.get("normals") or options.get("scores"):
        raise gppcs.ParameterError("expected neither normals nor scores: PDAL takes no other dimensions beside a mask")
    if not len(points):
        return True
    attributes = {attribute_called(name): values for name, values in ins.items() if name not in ("X", "Y", "Z")}
    result = gppcs.simplify(gppcs.PointCloud(points, attributes), **options)
    if not np.array_equal(result.cloud.points, points[result.indices]):
        raise gppcs.ParameterError(
            f"expected a method that leaves points where they are, as PDAL keeps or drops points; found {result.method}"
        )
    mask[result.indices] = True
    return True


def attribute_called(dimension: str) -> str:
    """Return the name that LAS files give a dimension of PDAL: "gps_time" for "GpsTime"."""
    name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", dimension).lower()
    return NAMES.get(name, name)
