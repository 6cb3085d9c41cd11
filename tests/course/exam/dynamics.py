"""Lectures 21 to 27 and 33: mass matrix, Christoffel symbols, gravity, regressors, formulas."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from tests.course.exam.arms import (
    GRAVITY,
    RIGHT,
    Arm,
    Array,
    cart,
    planar,
    random_arm,
    random_body,
    rod,
)
from tests.course.exam.question import At, Question
from tests.course.exam.velocity import evaluated

KINDS = ("RR", "RP", "PR", "RRR", "RRP", "PRR", "RRPR", "RRRRRR", "RRPRRR", "RRRRRRR")
#: Terms of an answer of `dynamics`, and where the notes define them.
LECTURES = {
    "mass_matrix": 24, "coriolis_matrix": 25, "gravity": 25, "christoffel_symbols": 25,
    "torques": 23, "kinetic_energy": 24, "potential_energy": 24,
}  # fmt: skip


def terms(arm: Arm, q: Array, qd: Array, qdd: Array) -> dict[str, Callable[[], Any]]:
    """Terms of the equations of motion, by the formulas of the notes."""
    return {
        "mass_matrix": partial(arm.mass_matrix, q),
        "coriolis_matrix": partial(arm.coriolis, q, qd),
        "gravity": partial(arm.gravity_forces, q),
        "christoffel_symbols": partial(arm.christoffel, q),
        "torques": partial(arm.torques, q, qd, qdd),
        "kinetic_energy": lambda: qd @ (arm.mass_matrix(q) + arm.motor_inertia) @ qd / 2.0,
        "potential_energy": partial(arm.energy, q),
    }


def cart_by_hand(m1: float, m2: float, rod: float, I2: float, q: Array, qd: Array) -> list[Any]:
    """D, C and G of lecture 26, with the sine that its scan lost."""
    c, s = np.cos(q[1]), np.sin(q[1])
    D = [[m1 + m2, -m2 * rod * c], [-m2 * rod * c, I2 + m2 * rod**2]]
    return [D, [[0.0, m2 * rod * s * qd[1]], [0.0, 0.0]], [0.0, -m2 * rod * GRAVITY * s]]


def planar_by_hand(m: Any, links: Any, lc: Any, inertias: Any, q: Array, qd: Array) -> list[Any]:
    """D, C and G of lecture 27."""
    h = -m[1] * links[0] * lc[1] * np.sin(q[1])
    d22 = m[1] * lc[1] ** 2 + inertias[1]
    d12 = d22 + m[1] * links[0] * lc[1] * np.cos(q[1])
    d11 = m[0] * lc[0] ** 2 + inertias[0] + m[1] * links[0] ** 2 + 2 * d12 - d22
    g2 = m[1] * lc[1] * GRAVITY * np.cos(q[0] + q[1])
    g1 = (m[0] * lc[0] + m[1] * links[0]) * GRAVITY * np.cos(q[0]) + g2
    C = [[h * qd[1], h * (qd[0] + qd[1])], [-h * qd[0], 0.0]]
    return [[[d11, d12], [d12, d22]], C, [g1, g2]]


def accelerations(arm: Arm, q: Array, qd: Array, tau: Array) -> Array:
    """q̈ = M⁻¹ (τ − C q̇ − B q̇ − G)."""
    return np.linalg.solve(arm.model(q, qd)[0], tau - arm.torques(q, qd, np.zeros(arm.n)))


def slotine(arm: Arm, q: Array, qd: Array, a: Array, v: Array) -> Array:
    """M a + C v + B q̇ + G."""
    M, C, G = arm.model(q, qd)
    return M @ a + C @ v + arm.friction @ qd + G


def by_parameters(found: Any) -> Array:
    return np.array(found["regressor"]) @ found["parameters"]


def by_base_parameters(found: Any) -> Array:
    return np.array(found["base_regressor"]) @ [one["value"] for one in found["base_parameters"]]


def random_terms(rng: np.random.Generator) -> Iterator[Question]:
    """Equations of motion of any table."""
    names, near = list(LECTURES), {"tolerance": 1e-7}
    for i, kinds in enumerate(
        ["RR", "RP", "PR", "RRR", "RRP", "PRR", "RRPR", "RRRRRR", "RRPRRR", "RRRRRRR"]
    ):
        n, bodies = len(kinds), tuple(random_body(rng) for _ in kinds)
        motors = tuple(map(tuple, rng.uniform(0.01, 0.3, (n, 2)))) if i % 2 else ()
        arm, (q, qd, qdd) = (
            random_arm(rng, kinds, bodies=bodies, motors=motors),
            rng.normal(size=(3, n)),
        )
        at, right = At(arm.table(), q), terms(arm, q, qd, qdd)
        moving = {"velocities": qd, "accelerations": qdd}
        for name in (*names[:2], names[2 + i % 5], names[2 + (i + 2) % 5]):
            lecture, kind = LECTURES[name], f"{name} of a random table"
            more = moving | near | {"christoffel_symbols": name == "christoffel_symbols"}
            yield at(lecture, kind, "dynamics", name, right[name], **more)
        tau, door, pick = rng.normal(size=n) * 5, "forward-dynamics", "accelerations"
        more = {"velocities": qd, "torques": tau, "tolerance": 1e-5}
        push = partial(accelerations, arm, q, qd, tau)
        yield at(25, "accelerations of torques", door, pick, push, **more)
        v = rng.normal(size=n)
        more = moving | near | {"reference_velocities": v}
        mixed = partial(slotine, arm, q, qd, qdd, v)
        yield at(34, "Y(q, qd, a, v) Theta", "regressor", by_parameters, mixed, **more)
        more, torques = moving | near, right["torques"]
        yield at(33, "fewest parameters", "regressor", by_base_parameters, torques, **more)


def by_hand(rng: np.random.Generator) -> Iterator[Question]:
    """Arms of lectures 26 and 27 with other numbers."""
    for _ in range(2):
        q, qd, qdd = rng.uniform(-1.5, 1.5, (3, 2))
        m1, m2, length, inertia = rng.uniform(0.2, 2, 4)
        m, lengths, shares = (
            rng.uniform(0.5, 3, 2),
            rng.uniform(0.3, 0.8, 2),
            rng.uniform(0.3, 0.7, 2),
        )
        bodies = tuple(rod(*one) for one in zip(m, lengths, shares, strict=True))
        inertias = [one[2][2, 2] for one in bodies]
        swing = At(cart(m1, m2, length, inertia).table(), q)
        arm = At(planar(lengths, bodies).table(), q)
        hand = cart_by_hand(m1, m2, length, inertia, q, qd)
        other = planar_by_hand(m, lengths, shares * lengths, inertias, q, qd)
        names = ("mass_matrix", "coriolis_matrix", "gravity")
        for name, one, two in zip(names, hand, other, strict=True):
            yield swing(26, "pendulum on a cart", "dynamics", name, one, velocities=qd)
            yield arm(27, "planar arm", "dynamics", name, two, velocities=qd)
        more = {"velocities": qd, "accelerations": qdd, "known_zeros": True}
        right = sorted([m1 + m2, m2 * length, inertia + m2 * length**2])

        def values(found: Any) -> Any:
            return sorted(one["value"] for one in found["base_parameters"])

        yield swing(33, "three parameters of the cart", "regressor", values, right, **more)


def formulas(rng: np.random.Generator) -> Iterator[Question]:
    """Formulas of small arms, evaluated by sympy."""
    a, b, c = rng.uniform(0.3, 0.7, 3)
    ball = (0.8, np.zeros(3), 0.02 * np.eye(3))
    slide = Arm("RP", np.array([[0, 0.3, 0, RIGHT], [0, 0.2, 0, 0]]), bodies=(ball, ball))
    rods = [rod(1.5, length) for length in (a, b, c)]
    for arm in (planar([a, b], rods[:2]), planar([a, b, c], rods), cart(1.1, 0.7, a, 0.03), slide):
        q, qd = rng.uniform(-1, 1, (2, arm.n))
        for lecture, path, right in (
            (9, "pose.position", arm.tip(q)[:3, 3]),
            (14, "jacobian", arm.jacobian(q)),
            (27, "dynamics.mass_matrix", partial(arm.mass_matrix, q)),
            (27, "dynamics.coriolis_matrix", partial(arm.coriolis, q, qd)),
            (27, "dynamics.gravity", partial(arm.gravity_forces, q)),
        ):
            kind, door = f"formulas: {path}", "robots/{}/equations?format=text"
            pick = partial(evaluated, path, q, qd=qd)
            yield Question(lecture, kind, door, None, pick, right, arm.table(), tolerance=1e-6)


def questions(rng: np.random.Generator) -> Iterator[Question]:
    for part in (random_terms, by_hand, formulas):
        yield from part(rng)
