"""Lectures 9 to 11: forward kinematics of any table, inverse kinematics with all branches."""

from collections.abc import Callable, Iterator
from functools import partial
from math import pi
from typing import Any

import numpy as np

from tests.course.exam.arms import (
    RIGHT,
    Arm,
    Array,
    homogeneous,
    planar,
    random_arm,
    random_rotation,
)
from tests.course.exam.question import At, Question, holds, split

#: Rows θ, d, a, α of the first three joints of arms with a spherical wrist. Those known to be
#: decoupled come first.
SHOULDERS: dict[str, list[Any]] = {
    "RRR elbow": [[0, 0.5, 0, RIGHT], [0, 0, 0.6, 0], [0, 0, 0, RIGHT]],
    "RRR offsets": [[0.2, 0.4, 0.1, -RIGHT], [-0.3, 0.12, 0.5, 0], [0.4, 0, 0.08, RIGHT]],
    "RRR skewed": [[0, 0.4, 0.15, 1.1], [0.3, 0.1, 0.5, -0.8], [0, 0.05, 0.1, 1.3]],
    "RRR skewed, far": [[0, 0.3, 0.3, 0.9], [0, -0.2, 0.6, 1.2], [0.5, 0.2, 0.15, -1.4]],
    "RRP spherical": [[0, 0.5, 0, -RIGHT], [0, 0.2, 0, RIGHT], [0, 0.6, 0, 0]],
    "RRP scara": [[0, 0.4, 0.5, 0], [0, 0, 0.4, pi], [0, 0.3, 0, 0.9]],
    "RRP skewed": [[0, 0.4, 0.2, 1.0], [0, 0.1, 0.1, 1.2], [0, 0.5, 0.1, 0.4]],
    "RPP cylindrical": [[0, 0.3, 0, 0], [0, 0.2, 0, -RIGHT], [0, 0.5, 0, 0]],
    "RPP skewed": [[0, 0.3, 0.1, 0.5], [0, 0.2, 0.2, 1.2], [0, 0.4, 0, 0.3]],
    "PPP cartesian": [[0, 0.2, 0, -RIGHT], [RIGHT, 0.3, 0, -RIGHT], [0, 0.3, 0, 0]],
    "PRR": [[0, 0.2, 0, 0], [0, 0.3, 0.5, RIGHT], [0, 0, 0.4, RIGHT]],
    "PRR scara": [[0, 0.2, 0, 0], [0, 0, 0.5, 0], [0, 0, 0.4, RIGHT]],
    "PRP": [[0, 0.2, 0, 0], [0, 0.1, 0.3, RIGHT], [0, 0.5, 0, 0]],
}
WRIST = [[0, 0.35, 0, -RIGHT], [0, 0, 0, RIGHT], [0, 0.12, 0, 0]]


def wristed(name: str, **more: Any) -> Arm:
    """An arm with a spherical wrist, whose centre is the origin of frames 4 and 5."""
    return Arm(name[:3] + "RRR", np.array([*SHOULDERS[name], *WRIST]), **more)


def apart(x: Array, y: Array, kinds: str) -> float:
    """Largest difference of configurations, whole turns apart."""
    off = np.asarray(x) - y
    turned = (off + pi) % (2 * pi) - pi
    return float(np.abs(np.where([kind == "R" for kind in kinds], turned, off)).max())


def newton_roots(residual: Callable[[Array], Array], starts: Array, kinds: str) -> list[Array]:
    """All roots of a residual from many starts, without copies by whole turns."""
    roots: list[Array] = []
    q, one = starts, np.eye(len(kinds))
    for _ in range(40):
        r = residual(q)
        J = np.stack([(residual(q + h) - r) / 1e-7 for h in 1e-7 * one], axis=-1)
        step = np.linalg.solve(J.mT @ J + 1e-12 * one, -(J.mT @ r[..., None]))[..., 0]
        q = q + step / np.maximum(1.0, np.abs(step).max(axis=1, keepdims=True))
    for x in q[np.abs(residual(q)).max(axis=1) < 1e-10]:
        if all(apart(x, y, kinds) > 1e-4 for y in roots):
            roots.append(x)
    return roots


def wrist_centre(arm: Arm, q: Array) -> Array:
    """The wrist's centre for many values of the first three joints."""
    H = np.broadcast_to(arm.base, (len(q), 4, 4))
    for (before, after), kind, x in zip(arm.fixed[:3], arm.kinds[:3], q.T, strict=True):
        step = np.tile(np.eye(4), (len(q), 1, 1))
        if kind == "R":
            step[:, 0, 0] = step[:, 1, 1] = np.cos(x)
            step[:, 1, 0], step[:, 0, 1] = np.sin(x), -np.sin(x)
        else:
            step[:, 2, 3] = x
        H = H @ before @ step @ after
    return H[:, :3, 3] + arm.rows[3, 1] * H[:, :3, 2]


def decoupled(arm: Arm, T: Array) -> list[Array]:
    """All branches by decoupling: roots for the wrist's centre, then both sets of wrist angles."""
    centre = T[:3, 3] - arm.rows[5, 1] * T[:3, 2]
    turns, slides = np.linspace(-pi, pi, 9)[:-1] + 0.1, np.linspace(-2.5, 2.5, 7)
    grids = [turns if kind == "R" else slides for kind in arm.kinds[:3]]
    starts = np.stack(np.meshgrid(*grids), axis=-1).reshape(-1, 3)
    result = []
    for q in newton_roots(lambda q: wrist_centre(arm, q) - centre, starts, arm.kinds[:3]):
        # The wrist is Rz(a) Rx(-π/2) Rz(b) Rx(π/2) Rz(c) = Rz(a) Ry(b) Rz(c).
        R = arm.chain([*q, 0, 0, 0])[1][3][:3, :3].T @ T[:3, :3]
        for k in (1, -1):
            b = np.arctan2(k * np.hypot(R[0, 2], R[1, 2]), R[2, 2])
            a, c = np.arctan2(k * R[1, 2], k * R[0, 2]), np.arctan2(k * R[2, 1], -k * R[2, 0])
            result.append(np.array([*q, a, b, c]))
    return result


def same_branches(kinds: str, answer: Any, expected: Any, _tolerance: float) -> str | None:
    """Differences of sets of branches, after reduction by turns."""
    distinct: list[Array] = []
    for q in map(np.array, answer):
        if all(apart(q, p, kinds) > 1e-5 for p in distinct):
            distinct.append(q)
    missing = [e for e in expected if all(apart(q, e, kinds) > 1e-5 for q in distinct)]
    if not missing and len(answer) == len(expected):
        return None
    counts = f"{len(answer)} answers, {len(distinct)} without turns, {len(expected)} branches"
    return f"{counts}; missing {np.round(missing, 4).tolist()}"


def ik(arm: Arm, T: Array, kind: str, pick: Any, right: Any, **more: Any) -> Question:
    lecture = 10 if arm.n == 6 else 11
    judged, asked = split(more)
    body = {"pose": {"transform": T}} | asked
    return Question(lecture, kind, "robots/{}/ik", body, pick, right, arm.table(), **judged)


def joints(found: Any) -> Any:
    return [one["joints"] for one in found["solutions"]]


def all_of(arm: Arm, T: Array, kind: str, right: Any, **more: Any) -> Question:
    """A question of all branches."""
    more |= {"all_solutions": True, "compare": partial(same_branches, arm.kinds)}
    return ik(arm, T, kind, joints, right, **more)


def two_links(a: float, b: float, x: float, y: float) -> list[Array]:
    """Both elbows of lecture 11 by the law of cosines."""
    elbow = np.arccos((x * x + y * y - a * a - b * b) / (2 * a * b))
    inner = np.arctan2(b * np.sin(elbow), a + b * np.cos(elbow))
    return [np.array([np.arctan2(y, x) - k * inner, k * elbow]) for k in (1, -1)]


def forward(rng: np.random.Generator) -> Iterator[Question]:
    """Lecture 9."""
    arms = "R RP RRP PRR RPRP RRRR PPP RRPRR RRRRRR RRPRRR PRRPRRR RRRRRRR"
    for kinds in arms.split():
        convention = ("standard", "modified")[len(kinds) % 3 == 2]
        base, tool = (homogeneous(random_rotation(rng), rng.uniform(-0.5, 0.5, 3)) for _ in "bt")
        arm = random_arm(rng, kinds, convention=convention, base=base, tool=tool)
        q, n = rng.uniform(-1, 1, arm.n), arm.n

        def pose(found: Any) -> Any:
            return np.c_[found["pose"]["rotation_matrix"], found["pose"]["position"]]

        def origins(found: Any, n: int = n) -> Any:
            return [found["links"][f"link_{i + 1}"]["position"] for i in range(n)]

        at, more = At(arm.table(), q), {"orientation": "rotation_matrix"}
        yield at(9, "pose of a random table", "fk", pose, arm.tip(q)[:3], **more)
        if convention == "standard":
            right = [H[:3, 3] for H in arm.chain(q)[1][1:-1]]
            yield at(9, "origins of the frames", "fk", origins, right)


def small_arms(rng: np.random.Generator) -> Iterator[Question]:
    """Closed forms of arms with fewer than six joints; ranges of whole turns are issue 2."""
    for wide in (3.1, 3.1, 6.28, 6.28):
        a, b, c, d = rng.uniform(0.3, 0.6, 4)
        more: Any = {"limits": (wide, 3.0)}
        wider = {"issue": 2 if wide > pi else 0}

        arm = planar([a, b], **more)
        T = arm.tip(rng.uniform(0.4, 2.0, 2))
        right: Any = two_links(a, b, *T[:2, 3])
        yield all_of(arm, T, "two links, both elbows", right, axes=["x", "y"], **wider)

        arm = planar([a, b, c])
        T = arm.tip(rng.uniform(0.4, 1.2, 3))
        turn, wrist = np.arctan2(T[1, 0], T[0, 0]), T[:2, 3] - c * T[:2, 0]
        right = [[*e, turn - sum(e)] for e in two_links(a, b, *wrist)]
        yield all_of(arm, T, "three links with a direction", right, axes=["x", "y", "rz"])

        # Below the flip about x the last joint of the scara turns the other way.
        rows = [[0, 0.4, a, 0], [0, 0, b, pi], [0, 0, 0, 0], [0, 0.1, 0, 0]]
        arm = Arm("RRPR", np.array(rows), **more)
        T = arm.tip(rng.uniform([-1, 0.4, 0.1, -1], [1, 1.5, 0.3, 1]))
        turn, slide = np.arctan2(T[1, 0], T[0, 0]), 0.3 - T[2, 3]
        right = [[*e, slide, sum(e) - turn] for e in two_links(a, b, *T[:2, 3])]
        yield all_of(arm, T, "scara", right, **wider)

        arm = Arm("RRR", np.array([[0, d, 0, RIGHT], [0, 0, a, 0], [0, 0, b, 0]]))
        T = arm.tip(rng.uniform([-1, 0.2, 0.3], [1, 0.8, 1.4]))
        x, y, z = T[:3, 3]
        sides = (np.arctan2(y, x), np.hypot(x, y)), (np.arctan2(-y, -x), -np.hypot(x, y))
        right = [[turn, *e] for turn, r in sides for e in two_links(a, b, r, z - d)]
        yield all_of(arm, T, "articulated arm, positions", right, axes=["x", "y", "z"])
    for reach in (1.2, 0.05):
        T, more = homogeneous(None, [reach, 0.0, 0.0]), {"axes": ["x", "y"], "refused": True}
        yield ik(planar([0.5, 0.4]), T, "out of reach", "code", "NO_IK_SOLUTION", **more)


def generic(arm: Arm, rng: np.random.Generator) -> Array:
    """A configuration inside the ranges, away from singular ones."""
    low, high = ([r if k == "R" else p for k in arm.kinds] for r, p in ((-2.0, 0.1), (2.0, 0.9)))
    while True:
        q = rng.uniform(low, high)
        if np.linalg.svd(arm.jacobian(q))[1][-1] > 0.03:
            return q


def wrists(rng: np.random.Generator) -> Iterator[Question]:
    """Lectures 10 and 11: arms with a spherical wrist."""
    for i, name in enumerate(SHOULDERS):
        for wide in (3.1, 6.28):
            arm = wristed(name, limits=(wide, 3.0))
            T = arm.tip(generic(arm, rng))
            right, more = partial(decoupled, arm, T), {"method": "analytic", "issue": 3 * (i > 3)}
            yield all_of(arm, T, f"decoupling of {name}", right, **more)
            yield all_of(arm, T, f"all branches of {name}", right, issue=2 * (i > 3))
        every = {"all_solutions": True}

        def names(found: Any) -> int:
            return len({one["branch"] for one in found["solutions"]} - {None})

        def count(arm: Arm = arm, T: Array = T) -> int:
            return len(decoupled(arm, T))

        yield ik(arm, T, "branches have names", names, count, issue=3, **every)
        yield ik(arm, T, "completeness is told", "complete", True, issue=2, **every)
        some = every | {"max_solutions": 1, "compare": holds}
        yield ik(arm, T, "a cut is told", "notes", "max_solutions", issue=2, **some)
        q = np.r_[generic(arm, rng)[:4], 0.0, 0.4]
        pick = "solutions.0.singular.-1"
        T = arm.tip(q)
        yield ik(arm, T, "a singular wrist is told", pick, "wrist", seed_joints=q, issue=3)
    T, more = homogeneous(None, [0.0, 0.0, 2.2]), {"method": "analytic", "refused": True}
    yield ik(wristed("RRR elbow"), T, "out of reach", "code", "NO_IK_SOLUTION", **more)


def questions(rng: np.random.Generator) -> Iterator[Question]:
    for part in (forward, small_arms, wrists):
        yield from part(rng)
