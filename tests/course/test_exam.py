"""An exam of the notes' methods on other arms and numbers: one question of each kind."""

import httpx
import numpy as np
import pinocchio as pin
import pytest

from tests.course.exam.arms import Arm, random_arm, random_body
from tests.course.exam.paper import paper
from tests.course.exam.question import Exam, Question, spread

PAPER = paper()
#: One of each kind.
QUICK = spread(PAPER, 1)


@pytest.fixture(scope="module")
def exam(service: httpx.Client) -> Exam:
    return Exam(service)


def test_the_paper_covers_the_lectures() -> None:
    assert len(PAPER) >= 300
    # Lectures 7 and 8 assign frames; 21, 22 are derivations, 1 and 2 introduce.
    assert {one.lecture for one in PAPER} == set(range(3, 35)) - {7, 8, 21, 22}


@pytest.mark.parametrize("question", QUICK, ids=[f"{one.lecture} {one.kind}" for one in QUICK])
def test_question(exam: Exam, question: Question) -> None:
    result = exam.ask(question)
    assert result.verdict == "right", f"{result.reason}: {result.answer} for {result.expected}"


@pytest.mark.parametrize("kinds", ["RRR", "RPR", "PRRPRR"])
@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_the_oracle_agrees_with_pinocchio(kinds: str, convention: str) -> None:
    rng = np.random.default_rng(5)
    arm = random_arm(
        rng, kinds, convention=convention, bodies=tuple(random_body(rng) for _ in kinds)
    )
    model = pinocchio_model(arm)
    data = model.createData()
    q, qd, qdd = rng.normal(size=(3, arm.n))
    np.testing.assert_allclose(arm.mass_matrix(q), pin.crba(model, data, q), atol=1e-10)
    np.testing.assert_allclose(
        arm.torques(q, qd, qdd), pin.rnea(model, data, q, qd, qdd), atol=1e-9
    )


def pinocchio_model(arm: Arm) -> pin.Model:
    model, joint, behind = pin.Model(), 0, np.eye(4)
    model.gravity.linear = np.array(arm.gravity)
    for i, (kind, (before, after)) in enumerate(zip(arm.kinds, arm.fixed, strict=True)):
        joint_model = pin.JointModelRZ() if kind == "R" else pin.JointModelPZ()
        joint = model.addJoint(joint, joint_model, pin.SE3(behind @ before), f"joint_{i}")
        model.appendBodyToJoint(joint, pin.Inertia(*arm.bodies[i]), pin.SE3(after))
        behind = after
    return model
