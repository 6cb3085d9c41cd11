"""Arms as Denavit-Hartenberg tables, with kinematics and dynamics by the formulas of the notes.

Derivatives are complex steps: exact to rounding, and independent of the product's.
"""

from dataclasses import dataclass, field
from functools import cached_property
from math import pi
from typing import Any

import numpy as np

Array = Any
GRAVITY, RIGHT = 9.81, pi / 2


def rotation(axis: str, angle: Any) -> Array:
    """The elementary rotations of lecture 3."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    R = np.eye(3, dtype=np.result_type(c, float))
    R[i, i], R[j, j], R[i, j], R[j, i] = c, c, -s, s
    return R


def homogeneous(R: Array | None = None, d: Any = (0.0, 0.0, 0.0)) -> Array:
    """The homogeneous transformation of lecture 6."""
    R = np.eye(3) if R is None else R
    H = np.eye(4, dtype=np.result_type(R, np.asarray(d), float))
    H[:3, :3], H[:3, 3] = R, d
    return H


def skew(w: Any) -> Array:
    """S(w) of lecture 12."""
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


@dataclass(frozen=True)
class Arm:
    """A chain of revolute (R) and prismatic (P) joints.

    Args:
        kinds: R or P for each joint.
        rows: θ, d, a, α of each row; θ or d is the offset of the joint variable.
        convention: Of the table.
        base: Frame 0 in the root frame.
        tool: The tip in frame n.
        bodies: Mass, centre of mass and inertia of each link, in its own frame.
        gravity: In the root frame [m/s²].
        motors: Inertia and viscous friction of each joint.
        limits: Range of revolute and of prismatic joints.
    """

    kinds: str
    rows: Array
    convention: str = "standard"
    base: Array = field(default_factory=lambda: np.eye(4))
    tool: Array = field(default_factory=lambda: np.eye(4))
    bodies: tuple[tuple[float, Array, Array], ...] = ()
    gravity: Any = (0.0, 0.0, -GRAVITY)
    motors: tuple[tuple[float, float], ...] = ()
    limits: tuple[float, float] = (3.1, 3.0)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.kinds)

    @cached_property
    def fixed(self) -> list[tuple[Array, Array]]:
        """Fixed transformations before and after the variable of each joint."""
        result, one = [], np.eye(4)
        for theta, d, a, alpha in self.rows:
            turn = homogeneous(rotation("z", theta), [0.0, 0.0, d])
            twist = homogeneous(rotation("x", alpha), [a, 0.0, 0.0])
            both = (one, turn @ twist) if self.convention == "standard" else (twist @ turn, one)
            result.append(both)
        return result

    def chain(self, q: Any) -> tuple[list[Array], list[Array]]:
        """Frames in which the joints move, and those of the links; the tip is the last one."""
        H, moving, links = self.base, [], [self.base]
        for kind, (before, after), value in zip(self.kinds, self.fixed, q, strict=True):
            H = H @ before
            moving.append(H)
            turn, slide = (value, 0.0) if kind == "R" else (0.0, value)
            H = H @ homogeneous(rotation("z", turn), [0.0, 0.0, slide]) @ after
            links.append(H)
        links.append(H @ self.tool)
        return moving, links

    def tip(self, q: Any) -> Array:
        """Pose of the tip, lecture 9."""
        return self.chain(q)[1][-1]

    def jacobian(self, q: Any, link: int | None = None, point: Any = (0.0, 0.0, 0.0)) -> Array:
        """Columns of lectures 13 and 14, of a point of a link; of the tip where none is named."""
        moving, links = self.chain(q)
        link = self.n + 1 if link is None else link
        p = links[link][:3, 3] + links[link][:3, :3] @ np.asarray(point)
        J = np.zeros((6, self.n), dtype=p.dtype)
        for j, (kind, H) in enumerate(zip(self.kinds[:link], moving, strict=False)):
            z, away = H[:3, 2], p - H[:3, 3]
            J[:, j] = np.r_[z, 0 * z] if kind == "P" else np.r_[np.cross(z, away), z]
        return J

    def mass_matrix(self, q: Any) -> Array:
        """D = Σ m J_vᵀ J_v + J_ωᵀ R I Rᵀ J_ω, lecture 25."""
        links, D = self.chain(q)[1], 0.0
        for i, (m, c, inertia) in enumerate(self.bodies, 1):
            J, R = self.jacobian(q, i, c), links[i][:3, :3]
            D = D + m * J[:3].T @ J[:3] + J[3:].T @ R @ inertia @ R.T @ J[3:]
        return D

    def energy(self, q: Any) -> Any:
        """U = −Σ m gᵀ r, lecture 24."""
        links = self.chain(q)[1]
        centres = [links[i][:3, 3] + links[i][:3, :3] @ b[1] for i, b in enumerate(self.bodies, 1)]
        return -sum(
            b[0] * np.dot(self.gravity, r) for b, r in zip(self.bodies, centres, strict=True)
        )

    def christoffel(self, q: Any) -> Array:
        """c_ijk = ½ (∂d_kj/∂q_i + ∂d_ki/∂q_j − ∂d_ij/∂q_k) as [i][j][k], lecture 25."""
        dD = np.array([slope(self.mass_matrix, q, i) for i in range(self.n)])
        return 0.5 * (
            np.transpose(dD, (0, 2, 1)) + np.transpose(dD, (2, 0, 1)) - np.transpose(dD, (1, 2, 0))
        )

    def coriolis(self, q: Any, qd: Any) -> Array:
        """[C]_kj = Σ_i c_ijk q̇_i."""
        return np.einsum("ijk,i->kj", self.christoffel(q), qd)

    def gravity_forces(self, q: Any) -> Array:
        """G = ∇U."""
        return np.array([slope(self.energy, q, i) for i in range(self.n)])

    @property
    def motor_inertia(self) -> Array:
        """J of the augmented model, lecture 28."""
        return np.diag([m[0] for m in self.motors]) if self.motors else np.zeros((self.n, self.n))

    @property
    def friction(self) -> Array:
        """B of the augmented model."""
        return np.diag([m[1] for m in self.motors]) if self.motors else np.zeros((self.n, self.n))

    def model(self, q: Any, qd: Any) -> tuple[Array, Array, Array]:
        """M = D + J, C and G."""
        return (
            self.mass_matrix(q) + self.motor_inertia,
            self.coriolis(q, qd),
            self.gravity_forces(q),
        )

    def torques(self, q: Any, qd: Any, qdd: Any) -> Array:
        """M q̈ + C q̇ + B q̇ + G."""
        M, C, G = self.model(q, qd)
        return M @ qdd + C @ qd + self.friction @ qd + G

    def table(self, **more: Any) -> dict[str, Any]:
        """The body of `POST /v1/robots`, without the name."""
        rows = []
        for i, (kind, (theta, d, a, alpha)) in enumerate(zip(self.kinds, self.rows, strict=True)):
            name, reach = ("revolute", "prismatic")[kind == "P"], self.limits[kind == "P"]
            row = {"type": name, "a": a, "alpha": alpha, "d": d, "theta": theta}
            row |= {"lower": -reach, "upper": reach, "velocity": 4.0, "acceleration": 30.0}
            row |= {"jerk": 900.0}
            if self.bodies:
                names = ("mass", "center_of_mass", "inertia")
                row |= dict(zip(names, self.bodies[i], strict=True))
            if self.motors:
                inertia, friction = self.motors[i]
                row |= {"motor_inertia": inertia, "viscous_friction": friction}
            rows.append(row)
        ends = {"base": {"transform": self.base}, "tool": {"transform": self.tool}}
        frame = {"convention": self.convention, "gravity": self.gravity}
        return {"dh": {"rows": rows} | frame | ends | more}


def slope(f: Any, q: Any, i: int) -> Any:
    """∂f/∂q_i by a complex step."""
    step = np.asarray(q, dtype=complex)
    step[i] += 1e-30j
    return np.imag(f(step)) / 1e-30


def random_rotation(rng: np.random.Generator) -> Array:
    """A rotation by three turns."""
    a, b, c = rng.uniform(-pi, pi, 3)
    return rotation("z", a) @ rotation("y", b) @ rotation("x", c)


def random_body(rng: np.random.Generator) -> tuple[float, Array, Array]:
    """Mass, centre and inertia of a brick that is turned."""
    m, sides = float(rng.uniform(0.5, 4.0)), rng.uniform(0.05, 0.4, 3) ** 2
    R = random_rotation(rng)
    inertia = R @ np.diag(m / 12.0 * (sides.sum() - sides)) @ R.T
    return m, rng.uniform(-0.2, 0.2, 3), (inertia + inertia.T) / 2.0


def random_arm(rng: np.random.Generator, kinds: str, **more: Any) -> Arm:
    """An arm with any twists and lengths."""
    n = len(kinds)
    rows = np.c_[
        rng.uniform(-1.0, 1.0, n), rng.uniform(-0.5, 0.5, n), rng.uniform(0.1, 0.6, n),
        rng.choice([0.0, pi / 2, -pi / 2, 0.7, -1.1], n),
    ]  # fmt: skip
    return Arm(kinds, rows, **more)


def planar(lengths: Any, bodies: Any = (), kinds: str = "", **more: Any) -> Arm:
    """An arm in the plane of its first frame; gravity is along −y."""
    rows = [[0.0, 0.0, length, 0.0] for length in lengths]
    more = {"gravity": (0.0, -GRAVITY, 0.0)} | more
    return Arm(kinds or "R" * len(rows), np.array(rows), bodies=tuple(bodies), **more)


def rod(mass: float, length: float, share: float = 0.5) -> tuple[float, Array, Array]:
    """A rod along x that ends at its frame's origin, its centre at a share of the length."""
    i = mass * length**2 / 12.0
    return mass, np.array([(share - 1.0) * length, 0.0, 0.0]), np.diag([0.1 * i, i, i])


def cart(m1: float, m2: float, length: float, inertia: float) -> Arm:
    """The pendulum on a cart of lecture 26; φ = 0 is upright."""
    bodies = ((m1, np.zeros(3), 0.01 * np.eye(3)), (m2, np.zeros(3), inertia * np.eye(3)))
    rows = np.array([[0.0, 0.0, 0.0, -RIGHT], [0.0, 0.0, length, 0.0]])
    return Arm("PR", rows, bodies=bodies, gravity=(-GRAVITY, 0.0, 0.0))
