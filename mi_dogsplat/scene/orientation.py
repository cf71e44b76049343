"""Which way is up: as a name, as a direction, and as cameras were held; and the matrix that sets a model upright.

A direction is told by the name of an axis, ``-y``, or by three numbers, ``0.1,-0.9,0.42``, of whatever length.
"""

from __future__ import annotations

import math

import numpy as np

UP = "-y"  # in the axes of 3DGS PLY and of OpenCV's cameras; in those of SPZ, glTF and OpenUSD the same is y
AXES = ("x", "y", "z", "-x", "-y", "-z")
SNAP = 2.0  # degrees: what is so near to an axis is called by its name; cameras tell up no better than to a degree
LONGEST, SHORTEST = 1e6, 1e-6  # of what three numbers may be
MAX_ROLL = 0.35  # root mean square of the cosine between the horizontals of pictures and up: about 20 degrees
TOWARDS_MEAN = 0.02  # weight of the mean up of the images: decides where all cameras have the same horizontal
PASSES = 5
LEVEL = 0.1  # cosine between the mean up of images and the vertical, below which the images do not tell its sign


def up_vector(up: str) -> np.ndarray:
    """The unit vector [3] that a name or three numbers tell. Raises ``ValueError`` for anything else."""
    if up in AXES:
        return np.eye(3)["xyz".index(up[-1])] * (-1 if up[0] == "-" else 1)
    try:
        numbers = [float(word) for word in up.split(",")]
    except ValueError:
        numbers = []
    length = math.hypot(*numbers)
    if len(numbers) != 3 or not SHORTEST < length < LONGEST:  # NaN is neither
        raise ValueError(f'"{up}" is not a direction')
    return np.array(numbers) / length


def up_name(direction: np.ndarray) -> str:
    """What tells a direction [3]: the axis within ``SNAP`` of it, else three numbers."""
    unit = direction / np.linalg.norm(direction)
    axis = int(np.argmax(np.abs(unit)))
    if abs(unit[axis]) >= math.cos(math.radians(SNAP)):
        return ("-" if unit[axis] < 0 else "") + "xyz"[axis]
    return ",".join(f"{value:.6f}" for value in unit)


def up_of_cameras(c2w: np.ndarray) -> np.ndarray:
    """The vertical [3] by cameras [N, 4, 4] (OpenCV axes).

    Cameras are mostly held level: their horizontals lie across the vertical, however steeply they look. So up is the
    direction that fits that best by least squares, and where several do, the one nearest to the mean up of the images,
    which are upright. Where the images are level as seen from above, all cameras look down rather than up.
    """
    right, down, ahead = np.moveaxis(c2w[:, :3, :3], 2, 0)  # [N, 3] each
    mean = -down.mean(axis=0)
    nearest = mean / np.linalg.norm(mean) if np.linalg.norm(mean) > 1e-3 else -down[0]
    up = nearest
    for _ in range(PASSES):  # each nearer to what the horizontals alone say, where they do
        across = right.T @ right / len(right) + TOWARDS_MEAN * (np.eye(3) - np.outer(up, up))  # [3, 3]
        up = np.linalg.eigh(across)[1][:, 0]
    sign = up @ mean if abs(up @ mean) > LEVEL else -(up @ ahead.mean(axis=0))
    return up if sign >= 0 else -up


def roll(c2w: np.ndarray, up: np.ndarray) -> float:
    """How far cameras [N, 4, 4] are from level about ``up`` [3]: root mean square of a cosine, 0..1."""
    return float(np.sqrt(np.mean((c2w[:, :3, 0] @ up) ** 2)))


def rotation_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The smallest rotation [3, 3] that takes the direction ``a`` [3] to ``b`` [3] (Rodrigues)."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    axis, cosine = np.cross(a, b), float(a @ b)
    if cosine < -1 + 1e-12:  # half a turn, about any axis across
        across = np.eye(3)[int(np.argmin(np.abs(a)))]
        across -= (across @ a) * a
        across /= np.linalg.norm(across)
        return 2 * np.outer(across, across) - np.eye(3)
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + skew + skew @ skew / (1 + cosine)


def placement(up: str | None, scale: float | None, to: str = UP) -> np.ndarray:
    """The matrix [4, 4] after which what is ``up`` in a model is ``to``, and a unit is a metre.

    What is None is left as it is, and a model for which nothing is to be done gets the identity.
    """
    matrix = np.eye(4)
    if up is not None:
        matrix[:3, :3] = rotation_between(up_vector(up), up_vector(to))
    matrix[:3] *= 1.0 if scale is None else scale
    return matrix
