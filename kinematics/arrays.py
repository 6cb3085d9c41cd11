"""Array types of the whole application, and read-only copies."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def frozen(values: ArrayLike) -> Array:
    """A read-only, contiguous copy of ``values`` as float64; what is one already, itself."""
    if _is_frozen(values):
        return values  # type: ignore[return-value]
    array = np.array(values, dtype=np.float64, order="C")
    array.setflags(write=False)
    return array


def _is_frozen(values: ArrayLike) -> bool:
    if type(values) is not np.ndarray or values.dtype != np.float64 or values.base is not None:
        return False  # a view may be of what can still be written to
    return values.flags.c_contiguous and not values.flags.writeable
