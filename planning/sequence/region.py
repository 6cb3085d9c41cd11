"""Regions of grasps and places, expanded into poses."""

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, numbers, typed
from kinematics.errors import InvalidOption
from kinematics.pose import from_axis_angle, transform

#: A range this near to a whole turn is one: both its ends are the same angle [rad].
_SAME_ANGLE = 1e-9


@typed
def grasp_region(
    T_object_tool: ArrayLike,
    axis: Sequence[float],
    angles: tuple[float, float],
    offsets: tuple[float, float] = (0.0, 0.0),
    samples: tuple[int, int] = (18, 1),
) -> Array:
    """Grasps about an axis of the object: T = Trans(d a) Rot(a, phi) T_object_tool.

    Args:
        T_object_tool: The grasp at angle 0 and offset 0, shape (4, 4).
        axis: Direction through the object's origin, in its frame, shape (3,).
        angles: Least and largest angle phi about it [rad].
        offsets: Least and largest way d along it [m].
        samples: Numbers of angles and of offsets.

    Returns:
        Shape (k, 4, 4), the angles change fastest.

    Raises:
        InvalidOption: The axis has no direction, a range is empty, or there are no samples.
    """
    direction = numbers(axis, "axis", (3,))
    length = float(np.linalg.norm(direction))
    if not length > 0.0:
        raise InvalidOption("the axis of a region has no direction", hint="Give a unit vector.")
    direction = direction / length
    base = numbers(T_object_tool, "T_object_tool", (4, 4))
    return np.array(
        [
            transform(from_axis_angle(direction, phi), d * direction) @ base
            for d, phi in product(_values(offsets, samples[1]), _angles(angles, samples[0]))
        ]
    )


@typed
def place_region(
    T_reference_object: ArrayLike,
    size: tuple[float, float],
    angles: tuple[float, float],
    samples: tuple[int, int, int] = (3, 3, 4),
) -> Array:
    """Poses of an object on a rectangle: T = T_reference_object Trans(x, y, 0) Rz(phi).

    Args:
        T_reference_object: The pose at the middle of the rectangle, its z across it, shape (4, 4).
        size: Lengths of the rectangle along x and y of that pose [m].
        angles: Least and largest angle phi about its z [rad].
        samples: Numbers along x, along y and of angles.

    Returns:
        Shape (k, 4, 4), nearest to the middle first.

    Raises:
        InvalidOption: A range is empty, or there are no samples.
    """
    base = numbers(T_reference_object, "T_reference_object", (4, 4))
    xs, ys = (
        _values((-0.5 * length, 0.5 * length), count)
        for length, count in zip(size, samples, strict=False)
    )
    offsets = sorted(product(xs, ys), key=lambda at: (at[0] ** 2 + at[1] ** 2, at))
    z = np.array([0.0, 0.0, 1.0])
    return np.array(
        [
            base @ transform(from_axis_angle(z, phi), [x, y, 0.0])
            for x, y in offsets
            for phi in _angles(angles, samples[2])
        ]
    )


def _values(ends: tuple[float, float], count: int) -> list[float]:
    low, high = numbers(ends, "a region's range", (2,)).tolist()
    if not low <= high:
        raise InvalidOption(f"a region's range is from {low:g} to {high:g}", hint="Swap its ends.")
    if count < 1:
        raise InvalidOption("a region needs one sample at least")
    if count == 1 or low == high:
        return [0.5 * (low + high)]
    return [float(value) for value in np.linspace(low, high, count)]


def _angles(ends: tuple[float, float], count: int) -> list[float]:
    low, high = numbers(ends, "a region's range", (2,)).tolist()
    if high - low > 2.0 * np.pi - _SAME_ANGLE and count > 1:
        return _values((low, high - (high - low) / count), count)
    return _values(ends, count)
