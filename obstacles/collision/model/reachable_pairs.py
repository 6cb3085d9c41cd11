"""Pairs of pieces that may be near each other, by their bounding balls."""

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices


@kernel
def reachable_pairs(
    centers: Array, radii: Array, margins: Array, first: Indices, starts: Indices, second: Indices,
    reach: float, pairs: Indices,
) -> int:  # fmt: skip
    """Write the pairs whose balls may be nearer to each other than ``reach`` and the margin.

    Args:
        centers: Centres of the balls of all pieces, shape (m, 3) [m].
        radii: Radii of the balls, shape (m,) [m].
        margins: Margins of the pieces, shape (m,) [m].
        first: Pieces that have partners, shape (n,).
        starts: Index at which the partners of each begin, and the last ones end, shape (n + 1,).
        second: The partners, shape (k,).
        reach: [m].
        pairs: Room for as many pairs as there are, shape (k, 2).

    Returns:
        How many were written to ``pairs``.
    """
    count = 0
    for k in range(len(first)):
        i = first[k]
        for j in second[starts[k] : starts[k + 1]]:
            x, y = centers[i, 0] - centers[j, 0], centers[i, 1] - centers[j, 1]
            z = centers[i, 2] - centers[j, 2]
            # Enlarged by its rounding errors: the bound itself decides. Half-spaces have no ball
            # and are all taken.
            limit = (radii[i] + radii[j] + margins[j] + reach) * (1.0 + 1e-9) + 1e-12
            if not x * x + y * y + z * z > limit * limit:
                pairs[count, 0], pairs[count, 1] = i, j
                count += 1
    return count
