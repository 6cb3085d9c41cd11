"""Stages of real work: lines, arcs, seams, inserts, signals and tools that change."""

from itertools import pairwise

import numpy as np
import pytest

import armwright as aw
from kinematics.errors import InvalidOption
from planning.sequence.stage import Into, Signal, Stage, StageSettings
from tests.planning.sequence.workshop import (
    HOME,
    Z,
    deburring,
    down,
    gripping,
    line,
    scene,
    work,
    worked,
)


def test_stages_join_and_each_is_proved_with_its_tool_and_load() -> None:
    stages = worked().stages
    assert [stage.index for stage in stages] == list(range(len(work())))
    assert all(stage.certificate.verified for stage in stages)
    for before, after in pairwise(stages):
        assert before.trajectory.end == pytest.approx(after.trajectory.start, abs=1e-12)
    told = [stage.certificate.premises for stage in stages]
    assert {p.tool for p in told[:16]} == {"jaw/tip"}
    assert {p.tool for p in told[16:]} == {"spindle/tip"}
    assert [p.attached for p in told].count(("peg",)) == 9


def test_the_tip_goes_where_lines_arcs_and_inserts_say() -> None:
    stages, arm = worked().stages, deburring()
    ends = {k: aw.fk(arm, stages[k].trajectory.end)[:3, 3] for k in (17, 18, 19)}
    assert ends[17] == pytest.approx([0.66, 0.06, 0.105], abs=1e-4)
    assert ends[18] == pytest.approx([0.54, 0.06, 0.105], abs=1e-4)
    assert ends[19] == pytest.approx([0.54, -0.06, 0.105], abs=2e-4)
    arc = stages[18].trajectory
    path = aw.fk(arm, arc.sample(np.linspace(0.0, arc.duration, 50)))[:, :3, 3]
    a, b, c = np.array([[0.66, 0.06], [0.6, 0.08], [0.54, 0.06]])
    matrix = np.array([2.0 * (b - a), 2.0 * (c - a)])
    middle = np.linalg.solve(matrix, [b @ b - a @ a, c @ c - a @ a])
    radii = np.linalg.norm(path[:, :2] - middle, axis=1)
    assert radii == pytest.approx(np.linalg.norm(a - middle), abs=3e-4)
    inserted = stages[9].trajectory
    tips = [aw.fk(gripping(), q)[:3, 3] for q in (inserted.start, inserted.end)]
    assert tips[0] - tips[1] == pytest.approx([0.0, 0.0, 0.02], abs=1e-4)
    stands = stages[-1].after.scene.obstacle("peg").T_world_obstacle[:3, 3]
    assert stands == pytest.approx([0.45, -0.25, 0.125], abs=1e-4)


def test_corners_of_lines_are_passed_within_their_blend() -> None:
    motion = worked().stages[17].trajectory
    speeds = motion.sample(np.linspace(0.2, motion.duration - 0.2, 200), 1)
    assert np.abs(speeds).max(axis=1).min() > 1e-2


@pytest.mark.parametrize(
    ("stages", "told"),
    [
        ((aw.Straight("insert", Z, "tool", 0.02, 0.02, into=Into(("block",))),), "nothing is held"),
        ((aw.Straight("retreat", Z, "object", 0.02, 0.02),), "of nothing"),
        (
            (aw.Move(), aw.Straight("approach", Z, "tool", 0.02, 0.02, StageSettings(
                robot=deburring())), aw.Move((aw.JointGoal(HOME),))),
            "between a motion and its approach",
        ),
        (
            (aw.Attach("peg"), aw.Wait(1.0, StageSettings(robot=deburring()))),
            "while something is held",
        ),
    ],
)  # fmt: skip
def test_contradictions_are_told(stages: tuple[Stage, ...], told: str) -> None:
    with pytest.raises(InvalidOption, match=told):
        aw.Task(aw.World(gripping(), scene()), HOME, stages)


def test_a_line_that_meets_something_says_so() -> None:
    stages = (
        aw.Move((aw.PoseGoal(down(0.45, 0.0, 0.2)),)),
        line(down(0.75, 0.0, 0.08)),
        Signal("signal", 1),
    )
    task = aw.Task(aw.World(gripping(), scene()), HOME, stages)
    found = aw.plan_task(task, aw.TaskOptions(10.0))
    assert isinstance(found, aw.SequenceFailure)
    assert found.stage == 1
    assert "block" in found.message
