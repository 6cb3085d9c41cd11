"""Lectures 20, 28 and 31 to 34: splines, and closed loops of five controllers."""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from tests.course.exam.arms import Arm, Array, planar, random_arm, random_body, rod
from tests.course.exam.question import Question, holds

#: Closed loops are compared at these times [s].
TIMES = np.linspace(0.0, 0.2, 5)
LECTURES = {"independent_joint": 20, "computed_torque": 28, "pd_gravity": 31, "passivity": 32,
            "adaptive": 34}  # fmt: skip


def coefficients(times: Array, points: Array, ends: Any) -> Array:
    """Coefficients of a cubic spline as [piece][joint][power]."""
    return np.transpose(CubicSpline(times, points, bc_type=ends).c[::-1], (1, 2, 0))


def splines(rng: np.random.Generator) -> Iterator[Question]:
    """Lecture 20: coefficients of cubic splines."""

    def pieces(found: Any) -> Any:
        return [one["coefficients"] for one in found["trajectory"]["segments"]]

    for n, number in ((1, 3), (2, 4), (2, 6), (3, 5), (6, 8)):
        times, points = np.cumsum(rng.uniform(0.3, 1.2, number)), rng.uniform(-1, 1, (number, n))
        (v, w), zero = rng.normal(size=(2, n)), np.zeros(n)
        first, last = {"start_velocity": v}, {"end_velocity": w}
        for kind, name, given, ends, issue in (
            ("natural spline", "natural", {}, "natural", 0),
            ("spline at rest at its ends", "clamped", {}, "clamped", 0),
            ("spline with velocities", "clamped", first | last, ((1, v), (1, w)), 0),
            ("one velocity given", "natural", first, ((1, v), (2, zero)), 6),
            ("one velocity given", "natural", last, ((2, zero), (1, w)), 6),
        ):
            timing = {"method": "spline", "times": times, "interpolation": f"{name}_spline"}
            body = {"path": {"joints": points}, "timing": timing | given}
            right = partial(coefficients, times, points, ends)
            yield Question(20, kind, "retime", body, pieces, right, issue=issue)


class Loop:
    """A closed loop of lecture 20, 28, 31, 32 or 34.

    Args:
        kind: Of the controller.
        arm: With its motors.
        gains: As the request has them.
        offset: Added to the start of the reference.
        cubic: Coefficients of the reference, a row for each joint.
    """

    def __init__(self, kind: str, arm: Arm, gains: Any, offset: Any, cubic: Array) -> None:
        self.kind, self.arm, self.gains, self.cubic = kind, arm, gains, cubic
        self.offset, self.start = offset, np.r_[cubic[:, 0] + offset, cubic[:, 1]]

    def reference(self, t: float) -> Array:
        """qʳ and its two derivatives."""
        powers = [[1, t, t**2, t**3], [0, 1, 2 * t, 3 * t**2], [0, 0, 2, 6 * t]]
        return np.array(powers) @ self.cubic.T

    def matrix(self, name: str) -> Array:
        gain = np.asarray(self.gains[name], dtype=float)
        return gain if gain.ndim == 2 else np.diag(gain)

    def torque(self, t: float, q: Array, qd: Array) -> Array:
        """The control law."""
        (r, rd, rdd), B, (M, C, G) = self.reference(t), self.arm.friction, self.arm.model(q, qd)
        e, ed = r - q, rd - qd
        if self.kind in ("passivity", "adaptive"):
            L, K = self.matrix("Lambda"), self.matrix("K")
            v, a = rd + L @ e, rdd + L @ ed
            return M @ a + C @ v + B @ qd + G + K @ (ed + L @ e)
        pull = self.matrix("Kp") @ e + self.matrix("Kd") @ ed
        if self.kind == "independent_joint":
            return self.arm.motor_inertia @ rdd + B @ rd + pull
        return pull + G if self.kind == "pd_gravity" else M @ (rdd + pull) + C @ qd + B @ qd + G

    def first_torque(self) -> Array:
        return self.torque(0.0, *np.split(self.start, 2))

    def course(self) -> Array:
        """q at the times."""

        def rate(t: float, x: Array) -> Array:
            q, qd = np.split(x, 2)
            M, C, G = self.arm.model(q, qd)
            rest = self.torque(t, q, qd) - C @ qd - self.arm.friction @ qd - G
            return np.r_[qd, np.linalg.solve(M, rest)]

        ends = (0.0, TIMES[-1])
        found = solve_ivp(rate, ends, self.start, "DOP853", TIMES, rtol=1e-9, atol=1e-11)
        return found.y[: self.arm.n].T

    def lyapunov(self) -> Array:
        """V and its rate at the start, by the proofs of lectures 31 and 32."""
        q, qd = np.split(self.start, 2)
        (r, rd, _), (M, _, _) = self.reference(0.0), self.arm.model(q, qd)
        e, ed = r - q, rd - qd
        if self.kind == "pd_gravity":
            Kp, D = self.matrix("Kp"), self.arm.friction + self.matrix("Kd")
            return np.array([qd @ M @ qd / 2 + e @ Kp @ e / 2, -qd @ D @ qd])
        L, K = self.matrix("Lambda"), self.matrix("K")
        s = ed + L @ e
        return np.array([s @ M @ s / 2 + e @ L @ K @ e, -ed @ K @ ed - e @ L @ K @ L @ e])

    def linear_errors(self) -> Array:
        """e of ë + Kd ė + Kp e = 0 at the last time, by the poles of each joint."""
        result = []
        for e, kp, kd in zip(-self.offset, self.gains["Kp"], self.gains["Kd"], strict=True):
            poles = np.roots([1.0, kd, kp]).astype(complex)
            start = np.array([e, 0.0], dtype=complex)
            weights = np.linalg.solve(np.array([[1.0, 1.0], poles]), start)
            result.append(np.real(weights @ np.exp(poles * TIMES[-1])))
        return np.array(result)

    def ask(self, kind: str, pick: Any, right: Any, issue: int = 0, **more: Any) -> Question:
        segment = {"t0": 0.0, "t1": TIMES[-1], "coefficients": self.cubic}
        body = {"robot": "{}", "controller": {"type": self.kind} | self.gains, "saturate": False}
        body |= {"trajectory": {"segments": [segment]}, "initial_state": {"offset": self.offset}}
        body |= {"relative_tolerance": 1e-10, "absolute_tolerance": 1e-12}
        body |= {"sample_period": TIMES[1]} | more
        compare = holds if pick == "notes" else None
        table, lecture = self.arm.table(), LECTURES[self.kind]
        one = Question(lecture, kind, "simulate", body, pick, right, table, 1e-6, compare)
        return one._replace(issue=issue)


def arms(rng: np.random.Generator) -> Iterator[Arm]:
    """Arms with two joints and motors."""
    for kinds in ("RR", "PR", "RP"):
        motors, (a, b) = tuple(map(tuple, rng.uniform(0.05, 0.4, (2, 2)))), rng.uniform(0.4, 0.7, 2)
        if kinds == "RR":
            yield planar([a, b], [rod(2.0, a), rod(1.2, b)], motors=motors)
        else:
            bodies = random_body(rng), random_body(rng)
            yield random_arm(rng, kinds, bodies=bodies, motors=motors)


def loops(rng: np.random.Generator) -> Iterator[Question]:
    """Torques, motions and Lyapunov functions of closed loops."""
    for i, arm in enumerate(arms(rng)):
        pd: Any = {"Kp": rng.uniform(30, 60, 2), "Kd": rng.uniform(8, 16, 2)}
        full = {"Kp": [[50.0, 8.0], [8.0, 40.0]], "Kd": [[12.0, 2.0], [2.0, 9.0]]}
        passive = {"Lambda": rng.uniform(2, 5, 2), "K": rng.uniform(4, 9, 2)}
        offset, cubic = rng.uniform(-0.2, 0.2, 2), rng.uniform(-0.4, 0.4, (2, 4))
        for kind in LECTURES:
            gains = passive if kind in ("passivity", "adaptive") else pd
            gains = full if kind == "pd_gravity" and i else gains
            # PD control with gravity compensation is for a reference that stands still.
            still = cubic * [1, 0, 0, 0] if kind == "pd_gravity" else cubic
            loop = Loop(kind, arm, gains, offset, still)
            # With an exact model the first torque of adaptation is that of passivity.
            yield loop.ask(f"torque of {kind}", "torque.0", loop.first_torque)
            if kind != "adaptive":
                yield loop.ask(f"motion under {kind}", "position", loop.course)
            if kind in ("pd_gravity", "passivity"):
                pick = partial(first, ("lyapunov", "lyapunov_rate"))
                yield loop.ask(f"V and its rate of {kind}", pick, loop.lyapunov)
            if kind == "computed_torque":
                yield loop.ask("linear errors", "tracking_error.-1", loop.linear_errors)
        wrong: Any = {"model_error": {"mass_scale": 1.4}, "sample_period": 0.01}

        def is_falling(found: Any) -> bool:
            return bool(max(found["lyapunov_rate"]) <= 1e-9)

        def error_of_estimate(found: Any) -> float:
            off = np.array(found["estimate"][0]) - found["true_parameters"]
            return float(found["lyapunov"][0] - off @ off / 2.0)

        yield loop.ask("V of adaptation falls", is_falling, True, **wrong)
        pick = partial(lambda loop: loop.lyapunov()[0], loop)
        yield loop.ask("V counts the error of the estimate", error_of_estimate, pick, **wrong)
        # K that does not commute with Λ: watched, with a note.
        mixed = {"Lambda": [2.0, 5.0], "K": [[6.0, 2.0], [2.0, 5.0]]}
        loop = Loop("passivity", arm, mixed, offset, cubic)
        yield loop.ask("K that does not commute", "position", loop.course, 6)
        yield loop.ask("the proof does not cover such a K", "notes", "commute", 6)


def first(names: tuple[str, ...], found: Any) -> Any:
    return [found[name][0] for name in names]


def questions(rng: np.random.Generator) -> Iterator[Question]:
    yield from splines(rng)
    yield from loops(rng)
