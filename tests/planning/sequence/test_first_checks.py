"""Early refusals of tasks: never of what can be done, and with numbers that others confirm."""

import numpy as np
import pytest

import armwright as aw
from kinematics.arrays import Array
from kinematics.pose import from_axis_angle, transform
from planning.sequence.first_checks import check_first
from planning.sequence.result import SequenceFailure, SequencePlan
from planning.sequence.search import plan_task
from planning.sequence.stage import Stage
from planning.sequence.world import Cells
from planning.values.deadline import Deadline
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.sequence.workshop import DOWN, HOME, Z, gripping


def crate(at: list[float], size: tuple[float, float, float] = (0.04, 0.04, 0.06)) -> aw.Scene:
    return aw.Scene([
        aw.Obstacle("bench", aw.Box((3.0, 3.0, 0.04)), aw.pose([1.8, 0.0, 0.0])),
        aw.Obstacle("crate", aw.Box(size), aw.pose(at)),
    ])  # fmt: skip


def stages(place: Array, contact: str | None = "contact") -> list[Stage]:
    grasps = np.array([transform(from_axis_angle(Z, a) @ DOWN) for a in (0.0, 0.5 * np.pi)])
    close = aw.Gripper("close", until="contact") if contact else aw.Gripper("close")
    return [
        aw.Move(), aw.Straight("approach", Z, "tool", 0.04, 0.08),
        aw.Grasp("crate", grasps, ("jaw",), "bench"), close, aw.Attach("crate"),
        aw.Straight("lift", Z, "root", 0.05, 0.1), aw.Move(),
        aw.Straight("approach", -Z, "root", 0.02, 0.05),
        aw.Place(None, place[None], support="bench"),
    ]  # fmt: skip


def early(scene: aw.Scene, work: list[Stage]) -> SequenceFailure | None:
    task = aw.Task(aw.World(gripping(), scene), HOME, tuple(work))
    return check_first(task, Cells(), Deadline.after(10.0), goals=True)


NEAR, FAR = aw.pose([0.45, -0.3, 0.05]), aw.pose([1.5, -0.3, 0.05])


@pytest.mark.parametrize(
    ("at", "place", "index"),
    [([1.4, 0.2, 0.05], NEAR, 2), ([0.45, 0.2, 0.05], FAR, 8), ([0.45, 0.2, 0.05], NEAR, None)],
)
def test_what_is_out_of_reach_is_told_before_any_search(
    at: list[float], place: Array, index: int | None
) -> None:
    failure = early(crate(at), stages(place))
    if index is None:
        assert failure is None
        return
    assert failure is not None
    assert failure.stage == failure.reached == index
    assert "m from the first joint" in failure.message or "m beyond" in failure.message
    assert {trial.outcome for trial in failure.trials} == {"out_of_reach"}
    target = np.array(at if index == 2 else place[:3, 3])
    assert failure.details["distance"] == pytest.approx(
        np.linalg.norm(target - [0.0, 0.0, 0.1625]), abs=1e-6
    )


def test_no_pose_that_an_arm_has_is_refused() -> None:
    """Poses of drawn configurations, all but stretched among them, by pinocchio."""
    random, refused = np.random.default_rng(1), 0
    for name in ("ur5e", "panda", "iiwa14", "kr6_sixx"):
        robot = aw.load_robot(name)
        judge, (low, high) = PinocchioArm(name), robot.chain.sampling_bounds()
        for k in range(25):
            q = random.uniform(low, high)
            q[2 + (robot.chain.n > 6)] *= 1.0 if k % 2 else 0.01  # the elbow
            q = np.clip(q, low, high)
            for gap in (0.0, 1.5):
                T = np.array(judge.pose(q))
                T[:3, 3] += gap * np.array([1.0, 0.0, 0.0]) * np.sign(T[0, 3])
                work = (aw.Move((aw.PoseGoal(T),)),)
                task = aw.Task(aw.World(robot, aw.Scene()), np.clip(q * 0.0, low, high), work)
                found = check_first(task, Cells(), Deadline.after(10.0), goals=True)
                told = found is not None and "out_of_reach" in found.message
                assert not (told and gap == 0.0), (name, q)
                refused += told
    assert refused > 60


def test_what_does_not_fit_between_the_fingers_is_told_with_both_widths() -> None:
    wide = crate([0.45, 0.2, 0.05], (0.12, 0.1, 0.06))
    failure = early(wide, stages(NEAR))
    assert failure is not None
    assert failure.stage == 2
    assert failure.details["width"] == pytest.approx(0.1)
    assert failure.details["opening"] == pytest.approx(0.085)
    assert "0.1 m wide" in failure.message
    assert "0.085 m" in failure.message
    # One side that fits is enough, and fingers that close elsewhere are not judged.
    assert early(crate([0.45, 0.2, 0.05], (0.12, 0.05, 0.06)), stages(NEAR)) is None
    assert early(wide, stages(NEAR, contact=None)) is None


def test_what_moves_before_is_left_to_the_search() -> None:
    """A crate out of reach of the second grasp's place is judged by where it then stands."""
    again = [
        *stages(NEAR), aw.Gripper("open"), aw.Detach(),
        aw.Straight("retreat", -Z, "tool", 0.05, 0.1), *stages(aw.pose([0.45, 0.2, 0.05])),
    ]  # fmt: skip
    scene = crate([0.45, 0.2, 0.05])
    assert early(scene, again) is None
    task = aw.Task(aw.World(gripping(), scene), HOME, tuple(again))
    assert isinstance(plan_task(task, aw.TaskOptions(30.0)), SequencePlan)
