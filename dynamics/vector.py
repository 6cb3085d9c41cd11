"""Three-vectors as tuples of floats, which stay in registers inside the kernels."""

from kinematics.chain import Array
from kinematics.kernel import kernel

Vector = tuple[float, float, float]


@kernel
def add(a: Vector, b: Vector) -> Vector:
    """The sum a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel
def subtract(a: Vector, b: Vector) -> Vector:
    """The difference a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def scale(s: float, a: Vector) -> Vector:
    """The multiple s a."""
    return s * a[0], s * a[1], s * a[2]


@kernel
def dot(a: Vector, b: Vector) -> float:
    """The scalar product a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a: Vector, b: Vector) -> Vector:
    """The vector product a x b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@kernel
def row(values: Array, i: int) -> Vector:
    """Row i of an (m, 3) array."""
    return values[i, 0], values[i, 1], values[i, 2]


@kernel
def axis(frames: Array, i: int) -> Vector:
    """The z axis of frame i of ``frames`` (n, 4, 4)."""
    return frames[i, 0, 2], frames[i, 1, 2], frames[i, 2, 2]


@kernel
def origin(frames: Array, i: int) -> Vector:
    """The origin of frame i of ``frames`` (n, 4, 4)."""
    return frames[i, 0, 3], frames[i, 1, 3], frames[i, 2, 3]


@kernel
def apply(matrix: Array, a: Vector) -> Vector:
    """The product M a, with M the upper left 3 x 3 of ``matrix``."""
    return (
        matrix[0, 0] * a[0] + matrix[0, 1] * a[1] + matrix[0, 2] * a[2],
        matrix[1, 0] * a[0] + matrix[1, 1] * a[1] + matrix[1, 2] * a[2],
        matrix[2, 0] * a[0] + matrix[2, 1] * a[1] + matrix[2, 2] * a[2],
    )


@kernel
def apply_transposed(matrix: Array, a: Vector) -> Vector:
    """The product M^T a, with M the upper left 3 x 3 of ``matrix``."""
    return (
        matrix[0, 0] * a[0] + matrix[1, 0] * a[1] + matrix[2, 0] * a[2],
        matrix[0, 1] * a[0] + matrix[1, 1] * a[1] + matrix[2, 1] * a[2],
        matrix[0, 2] * a[0] + matrix[1, 2] * a[1] + matrix[2, 2] * a[2],
    )


@kernel
def rotate_tensor(frame: Array, tensor: Array, rotated: Array) -> None:
    """Write R I R^T into ``rotated`` (3, 3), with R the rotation of ``frame`` (4, 4)."""
    for i in range(3):
        x, y, z = apply_transposed(tensor, (frame[i, 0], frame[i, 1], frame[i, 2]))
        for j in range(3):
            rotated[i, j] = x * frame[j, 0] + y * frame[j, 1] + z * frame[j, 2]
