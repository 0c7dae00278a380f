"""Makes a cloud of the image of a depth camera, by the pinhole model."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gppcs.clouds.cloud import PointCloud, array_of
from gppcs.errors import InputError, ParameterError, number, shown

Array = NDArray[np.float64]


def from_depth(
    depth: ArrayLike,
    intrinsics: ArrayLike,
    colour: ArrayLike | None = None,
    *,
    scale: float = 1.0,
    nearest: float = 0.0,
    farthest: float = math.inf,
) -> PointCloud:
    """Make a cloud of a depth image: one point for each pixel with a measurement.

    The pixel in column u and row v with depth z (after `scale`) becomes the point (x, y, z) that satisfies
    z (u, v, 1) = K (x, y, z). K is the camera matrix (Hartley and Zisserman, Multiple View Geometry, section 6.1).
    Lens distortion is not modelled. If it matters, undistort both images first.

    Parameters
    ----------
    depth : (H, W) array-like of real numbers
        Distance of each pixel from the camera plane, measured along the camera axis and not along the ray. Zero,
        negative, infinite and NaN values and masked pixels mean "not measured"; these pixels give no point.
    intrinsics : (3, 3) array-like, or (fx, fy, cx, cy)
        Camera matrix K = [[fx, skew, cx], [0, fy, cy], [0, 0, 1]] in pixels. The centre of the upper left pixel is at
        (0, 0).
    colour : (H, W, 3) array-like of uint8, optional
        Red, green and blue of the same pixels. If it comes from another camera, register it to the depth image first.
    scale : float
        Factor from the unit of `depth` to the unit of the cloud, such as 0.001 from millimetres to metres.
    nearest, farthest : float
        Range of valid depths in the unit of the cloud. Pixels outside it give no point. Use `farthest` to remove a
        value that means "too far", such as 65535 in 16-bit images.

    Returns
    -------
    PointCloud
        Points in the order of the pixels, row by row. The x axis points right, y down and z away from the camera. With
        `colour`, the points have the attributes `red`, `green` and `blue` (uint8). Coordinates are rounded to float32,
        or to float64 if the type of `depth` needs it (such as float64 or int32).

    Raises
    ------
    InputError
        If an image has the wrong shape or type, no pixel has a valid depth, or coordinates overflow.
    ParameterError
        If `intrinsics` is not the matrix of a pinhole camera, `scale` is not finite and above 0, or `nearest` is above
        `farthest`.

    Examples
    --------
    >>> depth = [[0, 1500, 1510], [1490, 1505, 1520]]  # in millimetres; 0 means not measured
    >>> cloud = gppcs.from_depth(depth, intrinsics=(525, 525, 1.0, 0.5), scale=0.001)
    >>> len(cloud)
    5

    Read images with any package that keeps their values. imageio does::

        from imageio.v3 import imread
        depth, colour = imread("depth.png"), imread("colour.png")[..., :3]

    OpenCV needs a flag to keep 16 bits, and its colours are blue, green, red::

        depth = cv2.imread("depth.png", cv2.IMREAD_UNCHANGED)
        colour = cv2.imread("colour.png")[..., ::-1]

    Matplotlib scales the values of PNG files to 0..1::

        depth = matplotlib.image.imread("depth.png") * 65535
        colour = (matplotlib.image.imread("colour.png")[..., :3] * 255).round().astype("uint8")
    """
    image = _depth_image(depth)
    focal, skew, centre = _pinhole(intrinsics)
    painted = None if colour is None else _colour_image(colour, image.shape)
    if not 0.0 < number(scale) < math.inf:
        raise ParameterError(
            f"expected a finite scale above 0, found {shown(scale)}; use 0.001 to convert millimetres to metres"
        )
    if not number(nearest) <= number(farthest):
        raise ParameterError(
            f"expected nearest to be at most farthest, found {shown(nearest)} and {shown(farthest)}; swap them"
        )

    z = image.astype(np.float64) * scale
    rows, columns = np.nonzero(np.isfinite(z) & (z > 0.0) & (z >= nearest) & (z <= farthest))
    if len(rows) == 0:
        raise InputError(
            f"expected pixels with a finite depth above 0, from {nearest} to {farthest}, found none in an image of "
            f"{image.shape[1]} x {image.shape[0]}; check scale, nearest and farthest"
        )
    y = (rows - centre[1]) / focal[1]
    x = (columns - centre[0] - skew * y) / focal[0]
    kept = np.dtype(np.float32 if np.result_type(image.dtype, np.float32) == np.float32 else np.float64)
    with np.errstate(over="ignore"):  # an error below reports overflow
        points = (z[rows, columns, None] * np.column_stack([x, y, np.ones(len(rows))])).astype(kept)
    if not np.isfinite(points).all():
        raise InputError(
            f"expected coordinates within the range of {kept}, found some that overflow; check scale and intrinsics"
        )
    attributes = {}
    if painted is not None:
        attributes = dict(zip(("red", "green", "blue"), painted[rows, columns].T.copy(), strict=True))
    return PointCloud(points, attributes, kept)


def _depth_image(depth: ArrayLike) -> NDArray[Any]:
    """Return the depth image as an array, (H, W), with 0 for masked pixels."""
    try:
        image: NDArray[Any] = np.ma.filled(np.ma.asarray(depth), 0)
    except ValueError as error:
        raise InputError("expected a depth image of shape (H, W), found rows of different lengths") from error
    if image.ndim != 2:
        raise InputError(f"expected a depth image of shape (H, W), found {image.shape}")
    if image.dtype.kind not in "iuf":
        raise InputError(f"expected real numbers in the depth image, found {image.dtype}")
    return image


def _colour_image(colour: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return the colour image as an array, (H, W, 3), for a depth image of the given shape."""
    image = array_of(colour, f"a colour image of shape {(*shape, 3)}")
    if image.shape != (*shape, 3):
        raise InputError(
            f"expected a colour image of shape {(*shape, 3)}, as the depth image, found {image.shape}; "
            "leave out alpha with colour[..., :3], and register images of different cameras first"
        )
    if image.dtype != np.uint8:
        raise InputError(f"expected colours of type uint8, 0 to 255, found {image.dtype}; convert them")
    return image


def _pinhole(intrinsics: ArrayLike) -> tuple[Array, float, Array]:
    """Return focal lengths (2,), skew and principal point (2,), all in pixels."""
    try:
        given = np.asarray(intrinsics, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ParameterError("expected numbers as intrinsics: (fx, fy, cx, cy) or a 3 x 3 matrix") from error
    if given.shape == (4,):
        given = np.array([[given[0], 0.0, given[2]], [0.0, given[1], given[3]], [0.0, 0.0, 1.0]])
    if given.shape != (3, 3):
        raise ParameterError(f"expected intrinsics of shape (3, 3), or (fx, fy, cx, cy), found shape {given.shape}")
    focal = given.diagonal()[:2]
    if not (np.isfinite(given).all() and (focal > 0.0).all()):
        raise ParameterError(f"expected finite intrinsics and focal lengths above 0, found {given.tolist()}")
    if given[1, 0] != 0.0 or given[2].tolist() != [0.0, 0.0, 1.0]:
        raise ParameterError(
            f"expected the matrix of a pinhole camera, [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], found "
            f"{given.tolist()}; transpose it if its last column is 0, 0, 1"
        )
    return focal, float(given[0, 1]), given[:2, 2]
