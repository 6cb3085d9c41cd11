"""Lectures 18 and 19: attraction, repulsion, their gradient in joint space, the descent."""

from typing import Any

import httpx
import numpy as np
import pytest

from tests.course.example import ROUNDING, ask
from tests.course.robots import A1, A2, revolute

Q, GOAL = [0.2, 0.4], [1.1, -0.5]
CENTRE, RADIUS = np.array([0.62, 0.62, 0.0]), 0.1
WEIGHTS, CAP, ETA, RHO = [1.5, 0.8], 0.35, 0.02, 0.4
OPTIONS: dict[str, Any] = {
    "attractive_weights": WEIGHTS,
    "attractive_cap": CAP,
    "repulsive_weights": ETA,
    "influence_distance": RHO,
}
BALL = {"id": "ball", "shape": {"type": "sphere", "radius": RADIUS},
        "pose": {"position": CENTRE.tolist()}}  # fmt: skip


def origins(q: Any) -> Any:
    """O_1 and O_2 of the two-link arm."""
    first = A1 * np.array([np.cos(q[0]), np.sin(q[0]), 0.0])
    return np.array([first, first + A2 * np.array([np.cos(sum(q)), np.sin(sum(q)), 0.0])])


def jacobians(q: Any) -> Any:
    """Linear Jacobians of O_1 and O_2; the column of joint 2 is zero for O_1."""
    z = np.array([0.0, 0.0, 1.0])
    O1, O2 = origins(q)
    first = np.column_stack([np.cross(z, O1), np.zeros(3)])
    return [first, np.column_stack([np.cross(z, O2), np.cross(z, O2 - O1)])]


def attraction(q: Any) -> Any:
    forces = []
    for point, end, weight in zip(origins(q), origins(GOAL), WEIGHTS, strict=True):
        e = point - end
        far = np.linalg.norm(e)
        forces.append(-weight * e * (1.0 if far <= CAP else CAP / far))
    return np.array(forces)


def joint_force(q: Any) -> Any:
    return sum(J.T @ F for J, F in zip(jacobians(q), attraction(q), strict=True))


def potential(q: Any) -> float:
    U: Any = 0.0
    for i, (point, end) in enumerate(zip(origins(q), origins(GOAL), strict=True)):
        far = np.linalg.norm(point - end)
        # Half the square near the goal, its tangent beyond the cap.
        U += WEIGHTS[i] * (far**2 / 2.0 if far <= CAP else CAP * far - CAP**2 / 2.0)
    return float(U)


def test_repulsion_grows_without_bound(service: httpx.Client) -> None:
    # The tip on the line from the base through the ball, nearer and nearer.
    sizes = []
    for gap in (0.1, 0.05, 0.02):
        ball = BALL | {"pose": {"position": [A1 + A2 + gap + RADIUS, 0.0, 0.0]}}
        body = {"joints": [0.0, 0.0], "goal_joints": GOAL, "options": OPTIONS,
                "scene": {"obstacles": [ball]}}  # fmt: skip
        tip = ask(service, "robots/notes_two_link/potential", body)["control_points"][-1]
        expected = ETA * (1.0 / gap - 1.0 / RHO) / gap**2
        assert tip["repulsive_force"] == pytest.approx([-expected, 0.0, 0.0], abs=1e-6)
        sizes.append(expected)
    assert sizes[0] < sizes[1] < sizes[2]


def test_the_iteration_of_lecture_19(service: httpx.Client) -> None:
    # q^{k+1} = q^k + alpha sum_i J_i^T F_i until |q - q_goal| < epsilon.
    alpha, epsilon = 0.2, 0.01
    body = {
        "robot": "notes_two_link", "start": {"joints": Q}, "goal": {"joints": GOAL},
        "planner": "potential_field",
        "planner_options": OPTIONS | {
            "step_sizes": alpha, "longest_step": 3.0, "tolerance": epsilon, "connect": False,
            "max_iterations": 2000, "patience": 2000},
    }  # fmt: skip
    found = ask(service, "plan", body)["potential_field"]
    q = np.array(Q)
    for answered in found["joints"][: found["iterations"] + 1]:
        np.testing.assert_allclose(answered, q, atol=1e-9)
        q = q + alpha * joint_force(q)
    assert np.linalg.norm(np.array(found["joints"][found["iterations"]]) - GOAL) < epsilon
    np.testing.assert_allclose(found["potentials"][0], potential(Q), atol=1e-9)


def test_control_points_are_the_origins_of_the_table(service: httpx.Client) -> None:
    # O_1 = (a_1, 0, d_1) at q = 0; a ball 5 cm above it pushes it down.
    table = {"convention": "standard", "rows": [revolute(0.3, d=0.4), revolute(0.2, d=0.1)]}
    assert (
        service.post("/v1/robots", json={"name": "notes_offsets", "dh": table}).status_code == 201
    )
    ball = BALL | {"pose": {"position": [0.3, 0.0, 0.55]}}
    body = {"joints": [0.0, 0.0], "goal_joints": [0.5, 0.5], "scene": {"obstacles": [ball]}}
    first = ask(service, "robots/notes_offsets/potential", body)["control_points"][0]
    assert first["origin"] == pytest.approx([0.3, 0.0, 0.4], abs=ROUNDING)
    assert first["distance"] == pytest.approx(0.05, abs=ROUNDING)
    expected = 2e-4 * (1.0 / 0.05 - 1.0 / 0.1) / 0.05**2  # eta and rho_0 by default
    assert first["repulsive_force"] == pytest.approx([0.0, 0.0, -expected], abs=1e-6)
