"""Lectures 3 to 6 and 12: rotations, their forms and compositions, homogeneous transformations."""

from collections.abc import Iterator
from functools import partial
from math import pi
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tests.course.exam.arms import Array, homogeneous, random_rotation, rotation, skew
from tests.course.exam.question import Question, holds

AXES = {"x": [1, 0, 0], "y": [0, 1, 0], "z": [0, 0, 1]}
MATRIX, TRANSFORM = "pose.rotation_matrix", "pose.transform"
#: How scipy reads each form.
READ: dict[str, Any] = {
    "quaternion_xyzw": Rotation.from_quat,
    "euler_zyz": partial(Rotation.from_euler, "ZYZ"),
    "rpy": partial(Rotation.from_euler, "xyz"),
    "axis_angle": lambda v: Rotation.from_rotvec(v[:3] * v[3]),
}


def convert(lecture: int, kind: str, body: Any, pick: Any, right: Any, **more: Any) -> Question:
    return Question(lecture, kind, "poses/convert", body, pick, right, **more)


def form(lecture: int, kind: str, given: str, value: Any, pick: Any, right: Any) -> Question:
    """A question of a pose in one form."""
    return convert(lecture, kind, {"pose": {given: value}}, pick, right)


def about(axis: str, angle: float, frame: str = "current") -> dict[str, Any]:
    return {"axis_angle": [*AXES[axis], angle], "about": frame}


def read(form: str, answer: Any) -> Array:
    """The rotation that an answered form stands for."""
    return READ[form](np.array(answer["pose"][form])).as_matrix()


def branches(R: Array, form: str) -> Array:
    """Both sets of zyz angles of lecture 5, or of roll, pitch and yaw; the one in [0, π] first."""
    result, turn = [], np.arctan2
    for k in (1, -1):
        if form == "euler_zyz":
            middle = turn(k * np.hypot(R[0, 2], R[1, 2]), R[2, 2])
            ends = (R[1, 2], R[0, 2]), (R[2, 1], -R[2, 0])
        else:
            middle = turn(-R[2, 0], k * np.hypot(R[0, 0], R[1, 0]))
            ends = (R[2, 1], R[2, 2]), (R[1, 0], R[0, 0])
        first, last = (turn(k * y, k * x) for y, x in ends)
        result.append([first, middle, last])
    return result


def compositions(rng: np.random.Generator) -> Iterator[Question]:
    """Lectures 3 and 4."""
    for axis in "xyz":
        for angle in rng.uniform(-pi, pi, 2):
            turn = [*AXES[axis], angle]
            right = rotation(axis, angle)
            yield form(3, "elementary rotation", "axis_angle", turn, MATRIX, right)
    for _ in range(3):
        R = random_rotation(rng)
        body = {"pose": {"rotation_matrix": R}, "inverse": True}
        yield convert(3, "inverse is the transpose", body, MATRIX, R.T)
    for _ in range(8):
        T, motions = np.eye(3), []
        for axis, frame in zip(rng.permutation([*"xyzx"]), [*"cfcf"], strict=True):
            angle = float(rng.uniform(-2, 2))
            R = rotation(axis, angle)
            T = T @ R if frame == "c" else R @ T
            motions.append(about(axis, angle, "current" if frame == "c" else "fixed"))
        yield convert(4, "current and fixed axes", {"motions": motions}, MATRIX, T)
    for _ in range(2):
        # M2 is about axes of frame 0, M3 about those of frame 1.
        A, B, C = (random_rotation(rng) for _ in range(3))
        motions = [{"rotation_matrix": R, "about": "fixed"} for R in (A, B, A.T, C, A)]
        right = A @ C @ A.T @ B @ A
        yield convert(4, "rotations in given frames", {"motions": motions}, MATRIX, right)


def forms(rng: np.random.Generator) -> Iterator[Question]:
    """Lecture 5."""
    for name in ("euler_zyz", "rpy"):
        for _ in range(4):
            R, pick = random_rotation(rng), f"pose.{name}_branches"
            right = branches(R, name)
            yield form(5, f"both branches of {name}", "rotation_matrix", R, pick, right)
            angles = rng.uniform(-1.5, 1.5, 3)
            yield form(5, f"matrix of {name}", name, angles, MATRIX, READ[name](angles).as_matrix())
    for middle in (0.0, pi, -pi):
        a, b = rng.uniform(-1.4, 1.4, 2)
        body = {"pose": {"euler_zyz": [a, middle, b]}}
        word = "phi - psi" if middle else "phi + psi"
        yield convert(5, "singular zyz angles", body, "singular.0.determined", word, compare=holds)
        R = rotation("z", a) @ rotation("y", middle) @ rotation("z", b)
        yield convert(5, "angles chosen at a singularity", body, partial(read, "euler_zyz"), R)
    for middle in (pi / 2, -pi / 2):
        angles = np.array([0.3, middle, rng.uniform(-1, 1)])
        yield form(5, "singular roll, pitch, yaw", "rpy", angles, "singular.0.form", "rpy")
    for name in ("axis_angle", "quaternion_xyzw"):
        for angle in (*rng.uniform(0.1, 3.0, 2), pi, 1e-7):
            axis = rng.normal(size=3)
            R = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
            yield form(5, f"{name} of a matrix", "rotation_matrix", R, partial(read, name), R)
    for _ in range(2):
        v = rng.normal(size=4)
        v, R = v / np.linalg.norm(v), Rotation.from_quat(v).as_matrix()
        yield form(5, "matrix of a quaternion", "quaternion_xyzw", v, MATRIX, R)


def transformations(rng: np.random.Generator) -> Iterator[Question]:
    """Lecture 6."""
    for _ in range(4):
        A, B, C = (homogeneous(random_rotation(rng), rng.uniform(-1, 1, 3)) for _ in range(3))
        motions = [{"transform": A}, {"transform": B, "about": "fixed"}, {"transform": C}]
        T = B @ A @ C
        yield convert(6, "composed transformations", {"motions": motions}, TRANSFORM, T)
        right = np.linalg.inv(T)
        yield form(6, "inverse transformation", "transform", T, "inverse.transform", right)
    for i, axis in enumerate("xyz"):
        d, angle = np.eye(3)[i] * 0.7, 0.4 + i
        T = homogeneous(None, d) @ homogeneous(rotation(axis, angle))
        body = {"motions": [{"position": d}, about(axis, angle)]}
        yield convert(6, "elementary transformations", body, TRANSFORM, T)


def angular_velocities(rng: np.random.Generator) -> Iterator[Question]:
    """Lecture 12: S(w) and the rate of a rotation."""
    for _ in range(3):
        R, w = random_rotation(rng), rng.normal(size=3)
        pose = {"pose": {"rotation_matrix": R}}
        body, rate = pose | {"angular_velocity": w}, skew(w) @ R
        yield convert(12, "S(w)", body, "skew", skew(w))
        yield convert(12, "rate of a rotation", body, "rotation_rate", rate)
        body = pose | {"rotation_rate": rate}
        yield convert(12, "w from R and its rate", body, "angular_velocity", w, issue=4)
    body = pose | {"rotation_rate": R + 1.0}
    more = {"compare": holds, "refused": True, "issue": 4}
    yield convert(12, "a rate of no rotation", body, "detail", "skew", **more)


def questions(rng: np.random.Generator) -> Iterator[Question]:
    for part in (compositions, forms, transformations, angular_velocities):
        yield from part(rng)
