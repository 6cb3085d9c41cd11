"""Lectures 12 to 17: velocities, Jacobians, gradient and inverse flows, singularities, statics."""

from collections.abc import Iterator
from functools import partial
from math import pi
from typing import Any

import numpy as np
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from tests.course.exam.arms import RIGHT, Arm, Array, planar, random_arm
from tests.course.exam.inverse import SHOULDERS, generic, wristed
from tests.course.exam.question import At, Question, field, holds

KINDS = ("RRR", "RRP", "PPR", "RPRP", "RRRRRR", "RRPRRR", "PRRRRRR", "RRRRRRR")
ROWS = ["x", "y", "z", "rx", "ry", "rz"]
ARTICULATED = Arm("RRR", np.array([[0, 0.4, 0, RIGHT], [0, 0, 0.5, 0], [0, 0, 0.35, 0]]))
SCARA = Arm("RRPR", np.array([[0, 0.4, 0.5, 0], [0, 0, 0.4, 0], [0, 0, 0, 0], [0, 0, 0, 0]]))
#: Axes of a task, and the arm.
TASKS = {
    "RRR": (["x", "y", "z"], ARTICULATED),
    "planar RRR": (["x", "y"], planar([0.5, 0.4, 0.3])),
    "planar RR": (["x", "y"], planar([0.6, 0.4])),
    "planar RRR with a direction": (["x", "y", "rz"], planar([0.5, 0.4, 0.3])),
    "spherical RRP": (["x", "y", "z"], Arm("RRP", np.array(SHOULDERS["RRP spherical"]))),
    "scara": (["x", "y", "z", "rz"], SCARA),
}


def rows_of(axes: list[str]) -> list[int]:
    return [ROWS.index(axis) for axis in axes]


def recursion(arm: Arm, q: Array, qd: Array) -> Array:
    """Velocities from frame to frame, lecture 12: those of the last origin and of its frame."""
    moving, links = arm.chain(q)
    v, w = np.zeros(3), np.zeros(3)
    for i, kind in enumerate(arm.kinds):
        z, step = moving[i][:3, 2], links[i + 1][:3, 3] - links[i][:3, 3]
        w = w + z * qd[i] * (kind == "R")
        v = v + np.cross(w, step) + z * qd[i] * (kind == "P")
    return np.r_[v, w]


def velocities(rng: np.random.Generator) -> Iterator[Question]:
    """Lectures 12 to 15."""
    for kinds in ("RR", "RP", "PRR", "RPR", "RRRR", "RRPRRR"):
        arm = random_arm(rng, kinds)
        q, qd = rng.uniform(-1, 1, arm.n), rng.normal(size=arm.n)
        at, right = At(arm.table(), q), recursion(arm, q, qd)
        yield at(12, "recursion", "velocity", "twist", right, joint_velocities=qd)
    for i, kinds in enumerate(
        ["RRR", "RRP", "PPR", "RPRP", "RRRRRR", "RRPRRR", "PRRRRRR", "RRRRRRR"]
    ):
        arm = random_arm(rng, kinds, convention=("standard", "modified")[i % 2])
        q = rng.uniform(-1, 1, arm.n)
        at, J = At(arm.table(), q), arm.jacobian(q)
        yield at(14, "Jacobian of a random table", "jacobian", "jacobian", J)
        yield at(13, "rows of w", "jacobian", lambda found: found["jacobian"][3:], J[3:])
        where = {"link": "link_2", "point": rng.uniform(-0.3, 0.3, 3)}
        right = arm.jacobian(q, 2, where["point"])
        yield at(19, "Jacobian of a point of a link", "jacobian", "jacobian", right, **where)
    for radius, height, speed in ((40.0, 80.0, 12.0), (12.5, 30.0, 5.0)):
        arm, w, t = Arm("R", np.array([[0, height, radius, 0]])), speed / radius, rng.uniform(0, 3)
        right = [-speed * np.sin(w * t), speed * np.cos(w * t), 0, 0, 0, w]
        at = At(arm.table(), [w * t])
        yield at(15, "helicopter", "velocity", "twist", right, joint_velocities=[w])
    for kinds in ("RRRRRR", "RRPRRR", "RRRRRRR"):
        arm = random_arm(rng, kinds)
        q = rng.uniform(-1, 1, arm.n)
        at, right = At(arm.table(), q), partial(analytic, arm, q)
        yield at(16, "analytic Jacobian", "jacobian", "jacobian", right, kind="analytic_zyz")


def analytic(arm: Arm, q: Array) -> Array:
    """J_a of positions and zyz angles: the angular rows through the rates of R_z R_y R_z."""
    J, (phi, theta, _) = arm.jacobian(q), Rotation.from_matrix(arm.tip(q)[:3, :3]).as_euler("ZYZ")
    s, c = np.sin(phi), np.cos(phi)
    B = [[0, -s, c * np.sin(theta)], [0, c, s * np.sin(theta)], [1, 0, np.cos(theta)]]
    return np.r_[J[:3], np.linalg.solve(B, J[3:])]


def inverse_velocities(rng: np.random.Generator) -> Iterator[Question]:
    """Lecture 16."""
    for kinds in ("RRRRRR", "RRPRRR", "RRRRRRR", "RRPRRRR", "RRRRRRRR", "RR", "RRR", "RPRR"):
        arm = random_arm(rng, kinds)
        q, xi, b = rng.uniform(-1, 1, arm.n), rng.normal(size=6) * 0.2, rng.normal(size=arm.n)
        at, J = At(arm.table(), q), arm.jacobian(q)
        plus, more = np.linalg.pinv(J), {"tolerance": 1e-6, "twist": xi, "damped_below": 0}
        name = "joint_velocities"
        if arm.n < 6:
            yield at(16, "residual", "velocity", "residual", xi - J @ plus @ xi, **more)
        else:
            yield at(16, "least norm", "velocity", name, plus @ xi, **more)
        if arm.n > 6:
            right = plus @ xi + b - plus @ J @ b
            yield at(16, "null space", "velocity", name, right, nullspace=b, **more)
    # Damping is told, and can be left out where the rank allows an inverse.
    arm, xi = wristed("RRR elbow"), np.array([0.1, -0.2, 0.05, 0.3, 0.1, -0.2])
    for bend in (0.03, 1e-3):
        q = np.array([0.4, 0.5, 0.6, -0.3, bend, 0.2])
        at, right = At(arm.table(), q), np.linalg.solve(arm.jacobian(q), xi)
        plainly, name = {"damped_below": 0, "tolerance": 1e-6 / bend}, "joint_velocities"
        yield at(16, "near a singularity", "velocity", name, right, twist=xi, **plainly)
        pick, right = "damped.0.singular_value", np.linalg.svd(arm.jacobian(q))[1][-1]
        yield at(16, "damping is told", "velocity", pick, right, twist=xi)


def tasks(rng: np.random.Generator) -> Iterator[Question]:
    """Tasks of fewer rows than six."""
    for i, (axes, arm) in enumerate(TASKS.values()):
        q = np.array([0.4, 0.7, 0.5, 0.3])[: arm.n]
        rows = rows_of(axes)
        J, v, b = arm.jacobian(q)[rows], rng.normal(size=len(axes)) * 0.2, rng.normal(size=arm.n)
        at, plus, more = At(arm.table(), q), np.linalg.pinv(J), {"axes": axes, "issue": 4}
        # A twist, or a wrench, has six numbers, or one for each of the axes.
        six = np.zeros(6)
        six[rows] = v
        twist = {"twist": six if i % 2 else v}
        name, right = "joint_velocities", plus @ v + b - plus @ J @ b
        yield at(16, "task: velocities", "velocity", name, plus @ v, **twist, **more)
        if arm.n > len(axes):
            yield at(16, "task: null space", "velocity", name, right, nullspace=b, **twist, **more)
        yield at(16, "task: Jacobian", "jacobian", "jacobian", J, **more)
        right = np.prod(np.linalg.svd(J)[1])
        yield at(16, "task: manipulability", "jacobian", "manipulability", right, **more)
        if arm.n == len(axes):
            tau, force = J.T @ v, lambda found: np.array(found["wrench"])
            yield at(17, "task: force from torques", "wrench", force, v, torques=tau, **more)
            path = "robots/{}/equations?format=text&axes=" + ",".join(axes)
            pick, right = partial(evaluated, "determinant", q), np.linalg.det(J)
            yield Question(14, "det J", path, None, pick, right, arm.table(), issue=6)
    stretched = (("RRR", [0.3, 0.6, 0.0], 2), ("RRR", [0.3, RIGHT, 0.0], 1), ("RRR", [0, 1, 1], 3),
                 ("planar RR", [0.5, 0.0], 1), ("planar RRR", [0.5, 0.0, 0.0], 1),
                 ("planar RRR", [0.5, pi, 0.3], 2))  # fmt: skip
    for name, bent, rank in stretched:
        (axes, arm), more = TASKS[name], {"issue": 4}
        at = At(arm.table(), bent)
        yield at(14, "rank of a stretched arm", "jacobian", "rank", rank, axes=axes, **more)


def ranks(rng: np.random.Generator) -> Iterator[Question]:
    """Lecture 14: singular configurations."""
    for name in ("RRR elbow", "RRR offsets", "RRP spherical"):
        arm = wristed(name)
        q = generic(arm, rng)
        at, right = At(arm.table(), q), abs(np.linalg.det(arm.jacobian(q)))
        yield at(14, "rank", "jacobian", "rank", 6)
        yield at(14, "manipulability", "jacobian", "manipulability", right)
        straight = At(arm.table(), [*q[:4], 0.0, 0.3])
        yield straight(14, "rank of a straight wrist", "jacobian", "rank", 5)


def evaluated(path: str, q: Array, found: Any, qd: Any = ()) -> Any:
    """Formulas of an answer of `equations` at a state, by sympy."""
    formulas = np.array(field(found, path), dtype=object)
    names = {one["symbol"]: one["value"] for one in found["parameters"]}
    names |= {one["symbol"]: float(x) for one, x in zip(found["joints"], q, strict=True)}
    names |= {f"qd_{i + 1}": float(x) for i, x in enumerate(qd)}

    def value(formula: str) -> float:
        symbols = {name: sp.Symbol(name) for name in names}
        return float(sp.sympify(formula, locals=symbols).subs(names))

    for one in found["abbreviations"]:
        names[one["symbol"]] = value(one["formula"])
    return np.reshape([value(one) for one in formulas.flat], formulas.shape)


def flow(arm: Arm, q: Array, target: Array, axes: list[str], rule: str, K: Array) -> Array:
    """q(0.3) of q̇ = Jᵀ K e or q̇ = J⁺ K e."""
    rows = rows_of(axes)

    def rate(_t: float, x: Array) -> Array:
        J, e = arm.jacobian(x)[rows], K @ (target - arm.tip(x)[:3, 3])[rows]
        return J.T @ e if rule == "transpose" else np.linalg.pinv(J) @ e

    return solve_ivp(rate, (0.0, 0.3), q, method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]


def third_step(arm: Arm, q: Array, target: Array, axes: list[str], gain: float) -> Array:
    """q after three steps of lecture 15."""
    rows = rows_of(axes)
    for _ in range(3):
        q = q + gain * arm.jacobian(q)[rows].T @ (target - arm.tip(q)[:3, 3])[rows]
    return q


def decay(found: Any) -> float:
    """How far the errors of a trace are off e(0) exp(-2 t)."""
    e, t = np.linalg.norm(found["trace"]["error"], axis=1), np.array(found["trace"]["time"])
    return float(np.abs(e - e[0] * np.exp(-2.0 * t)).max())


def gradients(rng: np.random.Generator) -> Iterator[Question]:
    """Lectures 15 and 16: descents and flows."""

    def ask(lecture: int, kind: str, on: Any, how: Any, pick: Any, right: Any, **more: Any) -> Any:
        arm, q, target, axes = on
        body = {"pose": {"position": target}, "axes": axes, "method": "gradient", "seed_joints": q}
        body |= {"gradient": {"trace": True} | how}
        path = "robots/{}/ik"
        return Question(lecture, kind, path, body, pick, right, arm.table(), **more)

    last = "trace.joints.-1"
    for name in ("RRR", "planar RR", "spherical RRP", "planar RRR"):
        axes, arm = TASKS[name]
        q = np.array([0.3, 0.9, 0.4])[: arm.n]
        about = arm, q, arm.tip(q + rng.uniform(-0.25, 0.25, arm.n))[:3, 3], axes
        how: dict[str, Any] = {"rule": "transpose", "form": "step", "gain": 0.8}
        right: Any = partial(third_step, *about, 0.8)
        yield ask(15, "third step", about, how, "trace.joints.3", right)
        how = {"rule": "pseudo_inverse", "form": "flow", "gain": 2.0}
        yield ask(16, "errors fall as exp(-K t)", about, how, decay, 0.0, tolerance=1e-5)
        K, more = np.diag(rng.uniform(1, 3, len(axes))), {"tolerance": 1e-6, "issue": 5}
        how = {"rule": "pseudo_inverse", "form": "flow", "gain": K, "duration": 0.3}
        right = partial(flow, *about, "pseudo_inverse", K)
        yield ask(16, "inverse flow for a duration", about, how, last, right, **more)
        how = {"rule": "transpose", "form": "flow", "gain": 1.5, "duration": 0.3}
        right = partial(flow, *about, "transpose", 1.5 * np.eye(len(axes)))
        yield ask(15, "gradient flow for a duration", about, how, last, right, **more)
    axes, arm = TASKS["planar RR"]
    for bend in (1e-2, 1e-3):
        q = np.array([0.4, bend])
        about = arm, q, 0.8 * arm.tip(q)[:3, 3], axes
        how = {"rule": "pseudo_inverse", "form": "flow", "duration": 0.3}
        right, more = partial(flow, *about, "pseudo_inverse", np.eye(2)), {"tolerance": 1e-4}
        yield ask(16, "flow near a singularity", about, how, last, right, issue=5, **more)
    # Jᵀ e = 0 where the force is along a stretched arm.
    how, said = {"rule": "transpose"}, {"refused": True, "compare": holds, "issue": 5}
    for turn, reach in ((0.0, 0.3), (0.0, 1.4), (RIGHT, 0.5)):
        about = arm, np.array([turn, 0.0]), reach * np.array([np.cos(turn), np.sin(turn), 0]), axes
        yield ask(15, "a stationary point is said", about, how, "detail", "stationary", **said)


def statics(rng: np.random.Generator) -> Iterator[Question]:
    """Lecture 17."""
    for kinds in ("RRR", "RRP", "PRR", "RRRRRR", "RRPRRR", "RRRRRRR"):
        arm = random_arm(rng, kinds)
        q, F = rng.uniform(-1, 1, arm.n), rng.normal(size=6) * 5
        at, tau, near = At(arm.table(), q), arm.jacobian(q).T @ F, {"tolerance": 1e-6}
        yield at(17, "torques of a wrench", "wrench", "torques", tau, wrench=F, **near)
        where = {"link": "link_2", "point": rng.uniform(-0.2, 0.2, 3)}
        right = arm.jacobian(q, 2, where["point"]).T @ F
        yield at(17, "wrench at a point", "wrench", "torques", right, wrench=F, **where, **near)
        if arm.n >= 6:
            more = {"issue": 4} | near
            yield at(17, "wrench from torques", "wrench", "wrench", F, torques=tau, **more)
    for q in rng.uniform(-1, 1, (2, 3)):
        at, load, near = At(ARTICULATED.table(), q), 12.0, 0.35 * np.cos(q[1] + q[2])
        right = [0, load * (near + 0.5 * np.cos(q[1])), load * near]
        wrench = {"wrench": [0, 0, load, 0, 0, 0]}
        yield at(17, "a load held by an RRR arm", "wrench", "torques", right, **wrench)


def questions(rng: np.random.Generator) -> Iterator[Question]:
    for part in (velocities, inverse_velocities, tasks, ranks, gradients, statics):
        yield from part(rng)
