"""From the image of a depth camera to a cloud, by the pinhole model."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.errors import InputError, ParameterError

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
    """Return the cloud that a depth camera saw: one point for each pixel with a measurement.

    The pixel in column u and row v, whose depth times `scale` is z, becomes the point (x, y, z) with
    (u, v, 1) z = K (x, y, z), where K is the camera's matrix (Hartley and Zisserman, Multiple View Geometry,
    section 6.1). Lens distortion is not modelled: undistort both images first where it matters.

    Parameters
    ----------
    depth : (H, W) array-like of real numbers
        Distance from the plane of the camera along its axis, not along the ray. Zero, negative, infinite and NaN
        mean that nothing was measured; those pixels are left out.
    intrinsics : (3, 3) array-like, or (fx, fy, cx, cy)
        K = [[fx, skew, cx], [0, fy, cy], [0, 0, 1]] in pixels, for images whose upper left pixel has its centre at
        (0, 0).
    colour : (H, W, 3) array-like of uint8, optional
        Red, green and blue of the same pixels: an image from a second camera must be registered to the depth
        image first.
    scale : float
        The unit of `depth` in the unit that the cloud is to have, such as 0.001 for millimetres to metres.
    nearest, farthest : float
        Depths outside this range, in the cloud's unit, are left out too; `farthest` takes away what stands for
        "beyond reach", such as 65535 in images of 16 bits.

    Returns
    -------
    PointCloud
        Points in the order of the pixels, row by row, with x to the right, y down and z away from the camera;
        attributes `red`, `green` and `blue` (uint8) where `colour` is given. Coordinates are exact in float32,
        which holds depths of 16 bits, or in float64 where the type of `depth` needs it.

    Raises
    ------
    InputError
        If an image has the wrong shape or type, or no pixel has a measurement in the range.
    ParameterError
        If the matrix is not that of a pinhole camera, the scale is not above 0, or the range holds nothing.

    Examples
    --------
    Images are read by whatever you have, as long as it leaves their numbers alone:

    >>> from imageio.v3 import imread
    >>> depth, colour = imread("depth.png"), imread("colour.png")[..., :3]
    >>> cloud = gppcs.from_depth(depth, (525, 525, 319.5, 239.5), colour, scale=0.001)

    OpenCV needs a flag to keep 16 bits, and its colours are blue, green and red:

    >>> depth = cv2.imread("depth.png", cv2.IMREAD_UNCHANGED)
    >>> colour = cv2.imread("colour.png")[..., ::-1]

    Matplotlib makes 0 to 1 of all that a PNG file can hold:

    >>> depth = matplotlib.image.imread("depth.png") * 65535
    >>> colour = (matplotlib.image.imread("colour.png")[..., :3] * 255).round().astype("uint8")
    """
    image = _depth_image(depth)
    focal, skew, centre = _pinhole(intrinsics)
    painted = None if colour is None else _colour_image(colour, image.shape)
    if not 0.0 < scale < math.inf:
        raise ParameterError(f"expected a finite scale above 0, found {scale}; 0.001 makes metres of millimetres")
    if not nearest <= farthest:
        raise ParameterError(f"expected nearest to be at most farthest, found {nearest} and {farthest}; swap them")

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
    with np.errstate(over="ignore"):  # told below
        points = (z[rows, columns, None] * np.column_stack([x, y, np.ones(len(rows))])).astype(kept)
    if not np.isfinite(points).all():
        raise InputError(
            f"expected coordinates that {kept} holds, found some that overflow; check scale and intrinsics"
        )
    attributes = {}
    if painted is not None:
        attributes = dict(zip(("red", "green", "blue"), painted[rows, columns].T.copy(), strict=True))
    return PointCloud(points, attributes, kept)


def _depth_image(depth: ArrayLike) -> NDArray[Any]:
    try:
        image: NDArray[Any] = np.ma.filled(np.ma.asarray(depth), 0)  # what is masked was not measured
    except ValueError as error:
        raise InputError("expected a depth image of shape (H, W), found rows of different lengths") from error
    if image.ndim != 2:
        raise InputError(f"expected a depth image of shape (H, W), found {image.shape}")
    if image.dtype.kind not in "iuf":
        raise InputError(f"expected real numbers in the depth image, found {image.dtype}")
    return image


def _colour_image(colour: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    image = np.asarray(colour)
    if image.shape != (*shape, 3):
        raise InputError(
            f"expected a colour image of shape {(*shape, 3)}, as the depth image, found {image.shape}; "
            "leave out alpha with colour[..., :3], and register images of different cameras first"
        )
    if image.dtype != np.uint8:
        raise InputError(f"expected colours of type uint8, 0 to 255, found {image.dtype}; convert them")
    return image


def _pinhole(intrinsics: ArrayLike) -> tuple[Array, float, Array]:
    """Return focal lengths, skew and centre, all in pixels."""
    try:
        given = np.asarray(intrinsics, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ParameterError("expected numbers as intrinsics: a 3 x 3 matrix or (fx, fy, cx, cy)") from error
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
