"""Random numbers inside kernels: the generator splitmix64.

Source: "Fast splittable pseudorandom number generators", ACM SIGPLAN Notices, 2014.
"""

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel

#: State of a generator, shape (1,); every value is a valid seed.
State = NDArray[np.uint64]

#: 2^64 over the golden ratio, made odd: what the state grows by.
_INCREMENT = np.uint64(0x9E3779B97F4A7C15)
#: The two multipliers of the mixing function, found by search for good avalanche.
_FIRST_MULTIPLIER = np.uint64(0xBF58476D1CE4E5B9)
_SECOND_MULTIPLIER = np.uint64(0x94D049BB133111EB)


@kernel(allocates=False)
def uniform_kernel(state: State) -> float:
    """The next number in [0, 1), a multiple of 2^-53; ``state`` is advanced."""
    state[0] += _INCREMENT
    x = state[0]
    x = (x ^ (x >> np.uint64(30))) * _FIRST_MULTIPLIER
    x = (x ^ (x >> np.uint64(27))) * _SECOND_MULTIPLIER
    x = x ^ (x >> np.uint64(31))
    return float(x >> np.uint64(11)) * 2.0**-53
