"""Composition of polynomials, q(s(t)), by Horner's rule."""

from compiled.kernel import kernel
from kinematics.arrays import Array


@kernel(allocates=False)
def compose_kernel(outer: Array, top: int, inner: Array, product: Array, out: Array) -> None:
    """Write the coefficients of outer(inner(t)).

    Args:
        outer: Ascending powers; those above ``top`` are not looked at, shape (>= top + 1,).
        top: Degree of the outer polynomial.
        inner: Ascending powers from 1 on (there is no constant), shape (d,).
        product: Scratch, shape (>= top d + 1,).
        out: Ascending powers, shape (>= top d + 1,); entries above top d stay as they are.
    """
    degree = inner.shape[0]
    out[0] = outer[top]
    used = 1
    for k in range(top - 1, -1, -1):
        for m in range(used + degree):
            product[m] = 0.0
        for m in range(used):
            for i in range(degree):
                product[m + 1 + i] += out[m] * inner[i]
        used += degree
        for m in range(used):
            out[m] = product[m]
        out[0] += outer[k]
