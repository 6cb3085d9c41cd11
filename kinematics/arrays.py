"""Arrays of numbers: read-only copies, and checks of what callers give."""

import numpy as np
from numpy.typing import ArrayLike

from compiled.arrays import Array, Indices
from kinematics.errors import InvalidNumbers, InvalidOption

__all__ = ["Array", "Indices", "as_numbers", "frozen", "numbers"]


def frozen(values: ArrayLike) -> Array:
    """A read-only, contiguous copy of ``values`` as float64; what is one already, itself.

    Raises:
        InvalidNumbers: They are none, or rows of different lengths.
    """
    if _is_frozen(values):
        return values  # type: ignore[return-value]
    try:
        array = np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError):
        array = as_numbers(values, "what is given")  # which tells what is wrong
    array.setflags(write=False)
    return array


def _is_frozen(values: ArrayLike) -> bool:
    if type(values) is not np.ndarray or values.dtype != np.float64 or values.base is not None:
        return False  # a view may be of what can still be written to
    return values.flags.c_contiguous and not values.flags.writeable


def as_numbers(values: ArrayLike, name: str) -> Array:
    """An array of numbers, of any shape, NaN and infinities among them.

    Raises:
        InvalidNumbers: They are none, or rows of different lengths.
    """
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InvalidNumbers(
            f"{name} is no array of numbers with rows of equal length: {str(values)[:40]!r}",
            hint="Give numbers, in rows of equal length.",
        ) from None


def numbers(values: ArrayLike, name: str, shape: tuple[int, ...] | None = None) -> Array:
    """An array of finite numbers.

    Args:
        values: Values as a caller gives them.
        name: Name of the argument.
        shape: Lengths that it has to have, -1 for any; None for any shape.

    Raises:
        InvalidOption: They are no finite numbers, or of another shape.
    """
    array = as_numbers(values, name)
    if shape is not None and not _has_shape(array, shape):
        wanted = str(shape).replace("-1", "any")
        raise InvalidOption(
            f"{name} has the shape {array.shape}, not {wanted}", hint="Give an array of that shape."
        )
    if not np.isfinite(array).all():
        raise InvalidOption(f"{name} is not finite", hint="Give numbers without NaN and infinity.")
    return array


def _has_shape(array: Array, shape: tuple[int, ...]) -> bool:
    lengths = zip(array.shape, shape, strict=False)
    return array.ndim == len(shape) and all(wanted in (-1, own) for own, wanted in lengths)
