"""Values of rows and their gradients.

Covectors on the velocity of a row's point and on the angular velocity of its carrier, both against
the reference, make the gradient in the joints.
"""

import math

from compiled.kernel import kernel
from compiled.vec3 import Vector, cross, dot, load, rotate, scale, subtract, turned_back
from kinematics.arrays import Array
from planning.constraints.row import Column, RowKind

# Numba reads module-level integers as constants, enums more slowly.
_JOINT = int(RowKind.JOINT)
_COORDINATE = int(RowKind.COORDINATE)
_DISTANCE = int(RowKind.DISTANCE)
_ANGLE = int(RowKind.ANGLE)
_LOOK = int(RowKind.LOOK)
#: Below this a length [m] or a sine names no direction.
_NO_DIRECTION = 1e-12


@kernel(allocates=False)
def point_kernel(frames: Array, row: Array) -> Vector:
    """The row's point in the base frame."""
    carrier = int(row[Column.CARRIER])
    if carrier < 0:
        return load(row, Column.POINT)
    F = frames[carrier]
    x, y, z = rotate(F, load(row, Column.POINT))
    return x + F[0, 3], y + F[1, 3], z + F[2, 3]


@kernel(allocates=False)
def relative_point_kernel(frames: Array, row: Array, P: Vector) -> Vector:
    """A point of the base frame in the row's reference."""
    reference = int(row[Column.REFERENCE])
    if reference < 0:
        return P
    F = frames[reference]
    return turned_back(F, subtract(P, (F[0, 3], F[1, 3], F[2, 3])))


@kernel(allocates=False)
def axis_kernel(frames: Array, row: Array) -> Vector:
    """The row's axis in its reference."""
    a = load(row, Column.AXIS)
    if row[Column.CARRIER] >= 0.0:
        a = rotate(frames[int(row[Column.CARRIER])], a)
    if row[Column.REFERENCE] >= 0.0:
        a = turned_back(frames[int(row[Column.REFERENCE])], a)
    return a


@kernel(allocates=False)
def to_base_kernel(frames: Array, row: Array, a: Vector) -> Vector:
    """A direction of the row's reference in the base frame."""
    if row[Column.REFERENCE] < 0.0:
        return a
    return rotate(frames[int(row[Column.REFERENCE])], a)


@kernel(allocates=False)
def log_kernel(E: Array) -> Vector:
    """The rotation vector of E (3, 3), through the quaternion's largest component."""
    t = E[0, 0] + E[1, 1] + E[2, 2]
    if t >= E[0, 0] and t >= E[1, 1] and t >= E[2, 2]:
        w, x = 1.0 + t, E[2, 1] - E[1, 2]
        y, z = E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]
    elif E[0, 0] >= E[1, 1] and E[0, 0] >= E[2, 2]:
        w, x = E[2, 1] - E[1, 2], 1.0 + E[0, 0] - E[1, 1] - E[2, 2]
        y, z = E[0, 1] + E[1, 0], E[0, 2] + E[2, 0]
    elif E[1, 1] >= E[2, 2]:
        w, x = E[0, 2] - E[2, 0], E[0, 1] + E[1, 0]
        y, z = 1.0 + E[1, 1] - E[0, 0] - E[2, 2], E[1, 2] + E[2, 1]
    else:
        w, x = E[1, 0] - E[0, 1], E[0, 2] + E[2, 0]
        y, z = E[1, 2] + E[2, 1], 1.0 + E[2, 2] - E[0, 0] - E[1, 1]
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)
    # Of a small rotation the quaternion is (e / 2, 1), here twice or four times as long.
    factor = 2.0 / w if sine < _NO_DIRECTION * w else 2.0 * math.atan2(sine, w) / sine
    return factor * x, factor * y, factor * z


@kernel(allocates=False)
def rotation_kernel(frames: Array, row: Array, E: Array) -> Vector:
    """Write K X of a ROTATION row into E (3, 3) and answer its rotation vector."""
    for column in range(3):
        a = (1.0 * (column == 0), 1.0 * (column == 1), 1.0 * (column == 2))
        if row[Column.CARRIER] >= 0.0:
            a = rotate(frames[int(row[Column.CARRIER])], a)
        if row[Column.REFERENCE] >= 0.0:
            a = turned_back(frames[int(row[Column.REFERENCE])], a)
        for i in range(3):
            k = Column.TURN + 3 * i
            E[i, column] = row[k] * a[0] + row[k + 1] * a[1] + row[k + 2] * a[2]
    return log_kernel(E)


@kernel(allocates=False)
def angle_kernel(a: Vector, d: Vector) -> float:
    """Angle of two unit vectors [rad], exact near 0 and pi too."""
    x, y, z = cross(a, d)
    return math.atan2(math.sqrt(x * x + y * y + z * z), dot(a, d))


@kernel(allocates=False)
def away_kernel(a: Vector, d: Vector) -> Vector:
    """Unit vector about which a has to turn to leave d fastest; 0 where a is along d."""
    x, y, z = cross(d, a)
    length = math.sqrt(x * x + y * y + z * z)
    if length > _NO_DIRECTION:
        return x / length, y / length, z / length
    if dot(a, d) > 0.0:
        return 0.0, 0.0, 0.0
    # Opposite: any way leads back; it is the one about which the angle falls.
    k = (
        0
        if abs(a[0]) <= abs(a[1]) and abs(a[0]) <= abs(a[2])
        else 1
        if abs(a[1]) <= abs(a[2])
        else 2
    )
    x, y, z = cross(a, (1.0 * (k == 0), 1.0 * (k == 1), 1.0 * (k == 2)))
    length = math.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


@kernel
def value_kernel(q: Array, frames: Array, row: Array, E: Array) -> tuple[float, Vector, Vector]:
    """A row's value and its covectors on the point's velocity and the angular velocity.

    Both are in the base frame; E (3, 3) is scratch. Of JOINT they mean nothing.
    """
    kind = int(row[Column.KIND])
    none = (0.0, 0.0, 0.0)
    center = load(row, Column.CENTER)
    d = load(row, Column.DIRECTION)
    if kind == _JOINT:
        return q[int(row[Column.CARRIER])], none, none
    if kind == _ANGLE:
        a = axis_kernel(frames, row)
        return angle_kernel(a, d), none, to_base_kernel(frames, row, away_kernel(a, d))
    if kind > _LOOK:
        e = rotation_kernel(frames, row, E)
        a = load(row, Column.AXIS)
        b = log_slope_kernel(e, a)
        k = row[Column.TURN : Column.TURN + 9].reshape(3, 3)
        back = turned_back(k, b)
        return dot(a, e), none, to_base_kernel(frames, row, back)
    x = relative_point_kernel(frames, row, point_kernel(frames, row))
    y = subtract(x, center)
    if kind == _COORDINATE:
        return dot(d, y), to_base_kernel(frames, row, d), none
    if kind == _DISTANCE:
        along = dot(d, y)
        y = subtract(y, scale(along, d))
        length = math.sqrt(dot(y, y))
        covector = scale(1.0 / length if length > _NO_DIRECTION else 0.0, y)
        return length, to_base_kernel(frames, row, covector), none
    a = axis_kernel(frames, row)
    length = math.sqrt(dot(y, y))
    if length <= _NO_DIRECTION:
        return math.pi, none, none
    u = (-y[0] / length, -y[1] / length, -y[2] / length)
    away = away_kernel(a, u)
    # u turns by (u x v) / |y| while the point moves by v: the angle is that of a seen from u.
    linear = scale(1.0 / length, cross(away, u))
    return (
        angle_kernel(a, u),
        to_base_kernel(frames, row, linear),
        to_base_kernel(frames, row, away),
    )


@kernel(allocates=False)
def log_slope_kernel(e: Vector, a: Vector) -> Vector:
    """Covector on w of a . d log(E) for E' = S(w) E: the transposed inverse left Jacobian times a.

    J^-T a = a + e x a / 2 + (1 - (t / 2) cot(t / 2)) / t^2  e x (e x a), t = |e|.
    """
    square = dot(e, e)
    if square < 1e-8:
        factor = 1.0 / 12.0 + square / 720.0
    else:
        half = 0.5 * math.sqrt(square)
        factor = (1.0 - half * math.cos(half) / math.sin(half)) / square
    first = cross(e, a)
    second = cross(e, first)
    return (
        a[0] + 0.5 * first[0] + factor * second[0],
        a[1] + 0.5 * first[1] + factor * second[1],
        a[2] + 0.5 * first[2] + factor * second[2],
    )


@kernel
def gradient_kernel(
    chain: Array, q: Array, frames: Array, row: Array, E: Array, gradient: Array
) -> float:
    """Write a row's gradient (n,) and answer its value."""
    value, linear, angular = value_kernel(q, frames, row, E)
    covector_kernel(chain, frames, row, linear, angular, gradient)
    if int(row[Column.KIND]) == _JOINT:
        gradient[int(row[Column.CARRIER])] = 1.0
    return value


@kernel(allocates=False)
def covector_kernel(
    chain: Array,
    frames: Array,
    row: Array,
    linear: Vector,
    angular: Vector,
    gradient: Array,
) -> None:
    """Write into (n,) what covectors on the velocities of a row's bodies make of each joint's."""
    carrier, reference = int(row[Column.CARRIER]), int(row[Column.REFERENCE])
    for j in range(gradient.shape[0]):
        gradient[j] = 0.0
    if int(row[Column.KIND]) == _JOINT:
        return
    P = point_kernel(frames, row)
    # Joints between the two bodies move one against the other: outwards one way, inwards the other.
    sign = 1.0 if carrier > reference else -1.0
    for j in range(min(carrier, reference) + 1, max(carrier, reference) + 1):
        F = frames[j]
        z = (F[0, 2], F[1, 2], F[2, 2])
        if chain[1 + j, 0] == 1.0:
            gradient[j] = sign * dot(linear, z)
        else:
            arm = cross(z, (P[0] - F[0, 3], P[1] - F[1, 3], P[2] - F[2, 3]))
            gradient[j] = sign * (dot(linear, arm) + dot(angular, z))


@kernel(allocates=False)
def sideways_kernel(frames: Array, row: Array, second: bool) -> tuple[float, Vector, Vector]:
    """A bound across the way that a distance or an angle is measured, and its covectors.

    A ball of radius u holds |e . y| <= u for every direction e, not just the one towards y: without
    those, steps towards a small ball or a narrow cone run past it. Infinite where there is none.
    """
    kind = int(row[Column.KIND])
    none = (0.0, 0.0, 0.0)
    d = load(row, Column.DIRECTION)
    if kind == _ANGLE:
        if second or row[Column.UPPER] >= 0.5 * math.pi:
            return math.inf, none, none
        a = axis_kernel(frames, row)
        w = away_kernel(a, d)
        return math.sin(row[Column.UPPER]), none, to_base_kernel(frames, row, cross(a, w))
    if kind not in (_DISTANCE, _LOOK):
        return math.inf, none, none
    x = relative_point_kernel(frames, row, point_kernel(frames, row))
    y = subtract(x, load(row, Column.CENTER))
    if kind == _LOOK:
        length = math.sqrt(dot(y, y))
        if second or row[Column.UPPER] >= 0.5 * math.pi or length <= _NO_DIRECTION:
            return math.inf, none, none
        a = axis_kernel(frames, row)
        w = away_kernel(a, (-y[0] / length, -y[1] / length, -y[2] / length))
        linear = (w[0] / length, w[1] / length, w[2] / length)
        return (
            math.sin(row[Column.UPPER]),
            to_base_kernel(frames, row, linear),
            to_base_kernel(frames, row, cross(a, w)),
        )
    along = dot(d, y)
    y = subtract(y, scale(along, d))
    length = math.sqrt(dot(y, y))
    line = dot(d, d) > 0.5
    if length <= _NO_DIRECTION or (line and second):
        return math.inf, none, none
    u = (y[0] / length, y[1] / length, y[2] / length)
    # Any unit vector across u; of a line, the one that is across the line too.
    e = d if line else away_kernel((-u[0], -u[1], -u[2]), u)
    if second or line:
        e = cross(u, e)
    return row[Column.UPPER], to_base_kernel(frames, row, e), none


@kernel(allocates=False)
def residual_kernel(value: float, row: Array) -> tuple[float, float]:
    """The residual of a row's value, and the sign of its slope."""
    above, below = value - row[Column.UPPER], row[Column.LOWER] - value
    return (above, 1.0) if above >= below else (below, -1.0)
