"""Arithmetic of functions of time known by value, slope and a bound of their curvature.

A jet (x_0, x_1, X, e) stands for every function on |s| <= h with

    |x(s) - x_0 - x_1 s| <= X s^2 / 2 + e,

e being what rounding can have done. With M_0 = |x_0| + |x_1| h + X h^2 / 2, M_1 = |x_1| + X h, and
N_0, N_1 likewise of y, the product has the value x_0 y_0, the slope x_0 y_1 + x_1 y_0 and the
curvature X N_0 + 2 M_1 N_1 + M_0 Y; and |(sin x)''| <= X + M_1^2.
"""

import math

from compiled.kernel import kernel

Jet = tuple[float, float, float, float]
JetVector = tuple[Jet, Jet, Jet]

#: Rounding of a product and of the sums that it enters, dozens of them [relative].
_ROUNDING = 64.0 * 2.0**-53


@kernel(allocates=False)
def size(x: Jet, h: float) -> float:
    """Largest absolute value over |s| <= h, rounding not included."""
    return abs(x[0]) + (abs(x[1]) + 0.5 * x[2] * h) * h


@kernel(allocates=False)
def add(x: Jet, y: Jet) -> Jet:
    """The sum x + y."""
    return x[0] + y[0], x[1] + y[1], x[2] + y[2], x[3] + y[3]


@kernel(allocates=False)
def scale(k: float, x: Jet) -> Jet:
    """The multiple k x for a number k."""
    return k * x[0], k * x[1], abs(k) * x[2], abs(k) * x[3]


@kernel(allocates=False)
def multiply(x: Jet, y: Jet, h: float) -> Jet:
    """The product x y over |s| <= h."""
    m, n = size(x, h), size(y, h)
    slopes = (abs(x[1]) + x[2] * h) * (abs(y[1]) + y[2] * h)
    curvature = x[2] * n + 2.0 * slopes + m * y[2]
    error = x[3] * (n + y[3]) + y[3] * m + _ROUNDING * m * n
    return x[0] * y[0], x[0] * y[1] + x[1] * y[0], curvature, error


@kernel(allocates=False)
def sine_cosine(x: Jet, h: float) -> tuple[Jet, Jet]:
    """The sine and cosine of x over |s| <= h."""
    s, c = math.sin(x[0]), math.cos(x[0])
    slope = abs(x[1]) + x[2] * h
    curvature, error = x[2] + slope * slope, x[3] + _ROUNDING
    return (s, c * x[1], curvature, error), (c, -s * x[1], curvature, error)


@kernel(allocates=False)
def plus(u: JetVector, v: JetVector) -> JetVector:
    """The sum u + v."""
    return add(u[0], v[0]), add(u[1], v[1]), add(u[2], v[2])


@kernel(allocates=False)
def cross(u: JetVector, v: JetVector, h: float) -> JetVector:
    """The vector product u x v over |s| <= h."""
    return (
        add(multiply(u[1], v[2], h), scale(-1.0, multiply(u[2], v[1], h))),
        add(multiply(u[2], v[0], h), scale(-1.0, multiply(u[0], v[2], h))),
        add(multiply(u[0], v[1], h), scale(-1.0, multiply(u[1], v[0], h))),
    )


@kernel(allocates=False)
def weighted_sum(a: float, b: float, c: float, v: JetVector) -> Jet:
    """The sum a v_x + b v_y + c v_z for numbers a, b, c."""
    return add(add(scale(a, v[0]), scale(b, v[1])), scale(c, v[2]))


@kernel(allocates=False)
def constant_vector(a: float, b: float, c: float) -> JetVector:
    """A vector that does not change."""
    return (a, 0.0, 0.0, 0.0), (b, 0.0, 0.0, 0.0), (c, 0.0, 0.0, 0.0)


@kernel(allocates=False)
def cross_constant(v: JetVector, a: float, b: float, c: float) -> JetVector:
    """The vector product v x (a, b, c) for numbers a, b, c."""
    return (
        add(scale(c, v[1]), scale(-b, v[2])),
        add(scale(a, v[2]), scale(-c, v[0])),
        add(scale(b, v[0]), scale(-a, v[1])),
    )
