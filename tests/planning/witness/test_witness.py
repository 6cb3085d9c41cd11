"""Witnesses of certified motions are accepted, and mutations of them rejected."""

import json
import subprocess
import sys
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.proof.certificate import certify
from planning.values.deadline import Deadline
from planning.values.limits import EffortLimits, MotionLimits
from planning.witness.witness import witness
from tests.mimic_joints import mimic_robot
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME, builtin, shelf
from tests.planning.witness.problems import (
    CHECKER,
    Proved,
    checker,
    compact,
    meshes,
    peg_in_tube,
    planned,
    rejected,
    reports,
)

CASES = [("panda", "shelf", 2), ("panda", "crowd", 2, 0.01), ("ur5e", "crowd", 4)]


@pytest.mark.parametrize("case", CASES)
def test_certified_motions_are_accepted(case: tuple[Any, ...]) -> None:
    """Every pair, all of time, read from the very text that the file has."""
    for item, report in zip(planned(*case), reports(planned, *case), strict=True):
        text = json.dumps(item.document)
        assert json.loads(text) == checker().read(compact(item.document)) == item.document
        assert report.unwitnessed == []
        assert report.facts >= report.pairs > 0
        solids = len(item.robot.pieces) + len(item.scene.pieces()[1])
        assert len(item.document["solids"]) == solids


def test_an_arm_of_meshes_is_accepted() -> None:
    """Convex parts stand for meshes wherever these stay apart."""
    for report in reports(meshes, 3):
        assert report.unwitnessed == []


def test_what_triangles_decide_is_named() -> None:
    """A bar in a tube, near the wall: hulls of the tube's parts reach to the bar."""
    item = peg_in_tube()
    assert certify(item.trajectory, item.robot, item.scene).verified
    told = checker().check(item.document).unwitnessed
    assert told
    for row in told:
        assert row["what"] == "pair"
        assert row["count"] == len(row["cells"]) > 0
        assert row["names"] == ["cart", "tube"]
    assert "nothing parts solids" in str(rejected({**item.document, "unwitnessed": []}))


def _wild(random: np.random.Generator, name: str) -> Trajectory:
    """A cubic from a random place, slow enough for the limits."""
    chain = builtin(name).chain
    c = np.zeros((1, chain.n, 4))
    c[0, :, 0] = HOME + random.uniform(-0.6, 0.6, chain.n)
    c[0, :, 1:] = random.uniform(-0.2, 0.2, (chain.n, 3))
    return Trajectory(chain.joint_names, np.array([0.0, 1.0]), c)


def test_no_motion_that_collides_is_accepted() -> None:
    """Random motions: what the checker accepts whole the proof certifies, and the other way."""
    random, robot, scene, both = np.random.default_rng(3), builtin("panda"), shelf(0.55), [0, 0]
    for _ in range(30):
        motion = _wild(random, "panda")
        proved = certify(motion, robot, scene).verified
        document = witness(motion, robot, scene).document
        accepted = rejected(document) is None and not document["unwitnessed"]
        assert accepted is proved
        both[proved] += 1
    assert min(both) > 3


def test_gaps_are_below_every_distance_that_pinocchio_finds() -> None:
    """Of corners of two solids on links, at random instants of a cell."""
    item, random = planned("panda", "shelf", 2)[0], np.random.default_rng(1)
    module, arm = checker(), PinocchioArm("panda")
    d, names = item.document, item.trajectory.joint_names
    bodies = [module.Body(row, k, len(names)) for k, row in enumerate(d["joints"])]
    motion = module.Motion(d, len(names))
    solids = [module.Solid(row, len(bodies)) for row in d["solids"]]
    looked = 0
    for a, b, number, *way in d["facts"]["plane"][::11]:
        begin, end = d["cells"][number]
        cell = module.Cell(motion, bodies, module.arb(begin), module.arb(end))
        gap = float(cell.gap(solids[a], solids[b], [module.arb(x) for x in way]).upper())
        for t in random.uniform(begin, end, 3):
            places = [_corners(arm, d, k, item.trajectory.sample([t])[0]) for k in (a, b)]
            distances = np.linalg.norm(places[0][:, None] - places[1], axis=2)
            round_ = d["solids"][a]["rounding"] + d["solids"][b]["rounding"]
            assert gap <= distances.min() - round_ + 1e-9
            looked += 1
    assert looked > 100


def _corners(arm: PinocchioArm, d: dict[str, Any], k: int, q: Array) -> Array:
    """Corners of a hull, or points of a cylinder's rims, joints placed by pinocchio."""
    row = d["solids"][k]
    T = np.array(row["transform"]).reshape(3, 4)
    if row["kind"] == "cylinder":
        turns = np.linspace(0.0, 2.0 * np.pi, 24)
        rim = row["radius"] * np.cos(turns), row["radius"] * np.sin(turns)
        sides = [np.full(24, z) for z in (row["half_height"], -row["half_height"])]
        row["vertices"] = np.vstack([np.column_stack([*rim, side]) for side in sides]).tolist()
    points = np.array(row["vertices"]) @ T[:, :3].T + T[:, 3]
    if row["body"] < 0:
        return np.asarray(points)
    link = arm.chain.links[arm.chain.index[row["name"]]]
    M = arm.pose(q, row["name"]) @ np.linalg.inv(link.T_joint_link)
    return np.asarray(points @ M[:3, :3].T + M[:3, 3])


def test_joints_that_follow_others_are_witnessed() -> None:
    """Cranks, covers and pistons are bodies of their own."""
    robot = mimic_robot()
    c = np.zeros((1, robot.chain.n, 2))
    c[0, :, 1] = 0.3
    motion = Trajectory(robot.chain.joint_names, np.array([0.0, 1.0]), c)
    document = witness(motion, robot, Scene(())).document
    assert any("follows" in row for row in document["joints"])
    assert rejected(document) is None


def test_what_the_format_has_no_words_for_is_counted() -> None:
    """Limits of tool speed and torque, tool motions, and a jerk that is not kept."""
    robot, item = builtin("panda"), planned("panda", "shelf", 2)[0]
    effort = EffortLimits(robot.chain, np.full(robot.chain.n, 1e3), 9.0)
    told = witness(
        item.trajectory,
        robot,
        item.scene,
        limits=MotionLimits(effort=effort),
        untold={"tool_motions": 2},
    ).document["unwitnessed"]  # fmt: skip
    counts = {row["what"]: row["count"] for row in told}
    assert counts == {"torque": robot.chain.n, "tool_speed": 1, "tool_motions": 2}
    bounds = {"velocity": np.full(7, 1e-3)}
    tight = witness(item.trajectory, robot, item.scene, limits=MotionLimits(bounds)).document
    assert "velocity of joint 0" in str(rejected(tight))


def test_a_robot_without_solids_is_told_of() -> None:
    """Nothing collides with it, and nothing of that is proved."""
    item, none = planned("panda", "shelf", 2)[0], np.zeros(0, dtype=np.int64)
    bare = RobotGeometry(item.robot.chain, (), (), none, none, {})
    document = witness(item.trajectory, bare, item.scene).document
    assert document["unwitnessed"] == [{"what": "solids", "count": 1}]
    assert rejected(document) is None


def test_what_there_was_no_time_for_is_named() -> None:
    """A deadline that has passed leaves pairs open; the rest is a witness still."""
    item = planned("ur5e", "crowd", 4)[0]
    told = witness(item.trajectory, item.robot, item.scene, deadline=Deadline.after(0.0))
    late = told.document
    assert rejected(late) is None
    assert len(late["cells"]) == 1
    assert len(late["unwitnessed"]) > 3


def test_odd_questions_are_refused() -> None:
    """Other joints, and a margin below 0."""
    item = planned("ur5e", "crowd", 4)[0]
    with pytest.raises(InvalidTrajectory, match="joints"):
        witness(item.trajectory, builtin("panda"), item.scene)
    with pytest.raises(InvalidOption, match="margin is -1"):
        witness(item.trajectory, item.robot, item.scene, margin=-1.0)


def test_the_checker_imports_nothing_of_the_product(tmp_path: Path) -> None:
    """It runs in a folder without it, and answers by its exit code."""
    item = planned("ur5e", "crowd", 4)[0]
    code = (
        "import sys; sys.path[:0] = [sys.argv.pop(1)]; import armwright_checker as c; n = c.main()"
    )
    code += (
        "; bad = {'numpy', 'planning', 'kinematics', 'obstacles', 'armwright'} & set(sys.modules)"
    )
    code += "; sys.exit(9 if bad else n)"
    for name, document in (("true", item.document), ("false", {**item.document, "cells": []})):
        path = tmp_path / name
        path.write_bytes(compact(document))
        command = [sys.executable, "-c", code, str(CHECKER.parent), str(path)]
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, env={"PATH": ""}, timeout=60
        )
        assert done.returncode == (0 if name == "true" else 1), done
        assert done.stdout.startswith("accepted" if name == "true" else "rejected")


Document = dict[str, Any]
Random = np.random.Generator


def _fact(d: Document, random: Random) -> int:
    return int(random.integers(len(d["facts"]["plane"])))


def turned(d: Document, random: Random) -> None:
    """A plane is turned round."""
    row = d["facts"]["plane"][_fact(d, random)]
    row[3:] = [-x for x in row[3:]]


def dropped(d: Document, random: Random) -> None:
    """A fact is dropped."""
    del d["facts"]["plane"][_fact(d, random)]


def forgotten(d: Document, random: Random) -> None:
    """All facts of a pair are dropped."""
    rows = d["facts"]["plane"]
    pair = rows[_fact(d, random)][:2]
    d["facts"]["plane"] = [row for row in rows if row[:2] != pair]


def swapped(d: Document, random: Random) -> None:
    """The two solids of a fact are swapped."""
    row = d["facts"]["plane"][_fact(d, random)]
    row[:2] = row[1::-1]


def shrunk(d: Document, random: Random) -> None:
    """A cell is shrunk."""
    cell = d["cells"][random.integers(len(d["cells"]))]
    share = random.uniform(0.01, 0.5)
    cell[random.integers(2)] = cell[0] + share * (cell[1] - cell[0])


def widened(d: Document, random: Random) -> None:
    """A cell is taken for all of time."""
    cells = d["cells"]
    k = random.choice([k for k, cell in enumerate(cells) if cell[1] - cell[0] < d["knots"][-1] / 3])
    cells[k] = [0.0, d["knots"][-1]]


def enlarged(d: Document, random: Random) -> None:
    """A solid grows by half a metre."""
    d["solids"][random.integers(len(d["solids"]))]["rounding"] += 0.5


def unallowed(d: Document, random: Random) -> None:
    """A pair that touches may touch no longer."""
    d["may_touch"] = []


def slowed(d: Document, random: Random) -> None:
    """A limit of velocity is below the fastest instant."""
    motion = _trajectory(d)
    times = np.linspace(0.0, motion.duration, 500)
    fastest = np.abs(motion.sample(times, 1)).max(axis=0)
    j = int(random.integers(len(fastest)))
    d["limits"]["velocity"][j] = float(fastest[j] * (1.0 - 1e-5))


def narrowed(d: Document, random: Random) -> None:
    """A limit of position is inside the motion."""
    positions = _trajectory(d).sample(np.linspace(0.0, d["knots"][-1], 500))
    j = int(random.integers(positions.shape[1]))
    d["limits"]["position"][j][0] = float(positions[:, j].min() + 1e-6)


def bent(d: Document, random: Random) -> None:
    """A coefficient is another one."""
    pieces = d["polynomials"]
    row = pieces[random.integers(len(pieces))][random.integers(len(pieces[0]))]
    row[random.integers(3)] += random.choice([-1, 1]) * random.uniform(1e-4, 1e-1)


def misplaced(d: Document, random: Random) -> None:
    """The motion ends elsewhere than it says."""
    d[random.choice(["start", "goal"])][random.integers(2)] += 1e-6


MUTATIONS: tuple[Callable[[Document, Random], None], ...] = (
    turned, dropped, forgotten, swapped, shrunk, widened, enlarged, unallowed, slowed, narrowed,
    bent, misplaced,
)  # fmt: skip


def _trajectory(d: Document) -> Trajectory:
    names = tuple(row["name"] for row in d["joints"] if "follows" not in row)
    return Trajectory(names, np.array(d["knots"]), np.array(d["polynomials"]))


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda f: f.__name__)
def test_mutations_are_rejected(mutation: Callable[[Document, Random], None]) -> None:
    """Of motions of two arms, each several times."""
    random, harmless = np.random.default_rng(17), 0
    items = [*planned("ur5e", "crowd", 4), planned("panda", "shelf", 2)[1]]
    for item in items:
        for _ in range(3):
            mutant = deepcopy(item.document)
            mutation(mutant, random)
            said = rejected(mutant)
            if said is None:
                harmless += 1
                assert mutation in {dropped, shrunk, widened, enlarged}, mutant["hashes"]
    # Others may hold what a fact or a cell did, and a solid may be far from all; not often.
    assert harmless <= (0 if mutation is dropped else 3)


def _least(item: Proved, obstacle: str) -> float:
    """Least distance of an obstacle at many instants, by FCL [m]."""
    world, times = FclWorld(item.robot, item.scene), np.linspace(0.0, item.trajectory.duration, 60)
    moving = {name for name, j in zip(item.robot.links, item.robot.joints, strict=True) if j >= 0}
    return min(
        world.distance_between(q, (name, obstacle))
        for q in item.trajectory.sample(times)
        for name in moving
    )


def test_a_solid_grows_until_it_would_touch() -> None:
    """Of solids that grow a little at a time, none is accepted that FCL finds too near."""
    random = np.random.default_rng(4)
    accepted = 0
    for item in planned("ur5e", "crowd", 4):
        least = _least(item, "post")
        for grown in random.uniform(0.0, 2.0, 6) * least:
            mutant = deepcopy(item.document)
            row = next(row for row in mutant["solids"] if row["name"] == "post")
            row["rounding"] += float(grown)
            said = rejected(mutant)
            assert said is not None or grown <= least
            accepted += said is None
    assert accepted > 0
