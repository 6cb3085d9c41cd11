"""Arms of example-robot-data as they lie: ``python -m benchmarks.arms [--write docs/arms.md]``.

Every URDF is uploaded without an edit: as a request whose only fields beside the files are
``default_limits`` and, where a tree has several arms, ``tip_link``: one of the candidates that the
refusal names. Told are the processor time of the upload, plans among obstacles, round trips of
inverse kinematics, and verdicts beside FCL on the triangles themselves, moved by pinocchio. Of arms
that come with an SRDF, a second table tells what ``allow_suspected`` does where it is not sent.
"""

import argparse
import base64
import json
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from statistics import median

import numpy as np

from armwright_wire.robots.robot import RobotBody
from benchmarks.judges.triangles import Triangles, scenery
from benchmarks.problems.example_arms import ExampleArm, mesh_bytes, package
from benchmarks.problems.mesh_scenes import own_scenes, reach_of
from kinematics.arrays import Array
from kinematics.forward import forward, link_poses
from kinematics.ik.inverse import inverse_kinematics
from kinematics.tree.description import MeshGeometry
from kinematics.tree.serial_chain import select
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Plan
from service.translate.robots.robots import robot as uploaded

#: Scenes that each arm plans in, and problems in each.
SCENES, PROBLEMS = 3, 2
#: Configurations for round trips, and for verdicts.
ROUND_TRIPS, VERDICTS = 30, 200
#: Configurations tried for one that is free.
TRIES = 400
#: Configurations of which the free ones are counted, with and without suspected pairs.
STATES = 2000
#: A round trip ends this close to where it began [m, and as the entries of a rotation].
CLOSE = 1e-4
#: Verdicts may differ for distances below this [m].
BAND = 1e-6
#: Heads of both tables.
COLUMNS = (
    "arm", "joints", "tip", "triangles", "upload", "free", "plans", "time", "IK", "verdicts",
)  # fmt: skip
SUSPECTED_COLUMNS = (
    "arm", "suspected pairs", "free as it lies", "with `allow_suspected`", "with its SRDF",
)  # fmt: skip
BEGIN, END = "<!-- {}: begin -->", "<!-- {}: end -->"

#: By name: the URDF in the package, and the tip where the tree has several arms.
UPLOADS = {
    "UR3": ("ur_description/urdf/ur3_robot.urdf", None),
    "UR5": ("ur_description/urdf/ur5_robot.urdf", None),
    "UR10": ("ur_description/urdf/ur10_robot.urdf", None),
    "UR3 with gripper": ("ur_description/urdf/ur3_gripper.urdf", None),
    "UR5 with gripper": ("ur_description/urdf/ur5_gripper.urdf", None),
    "Panda": ("panda_description/urdf/panda.urdf", None),
    "Kinova Jaco": ("kinova_description/robots/kinova.urdf", None),
    "ANYmal with Kinova": ("anymal_b_simple_description/robots/anymal-kinova.urdf", None),
    "xArm7": ("xarm_description/urdf/xarm7.urdf", None),
    "Z1": ("z1_description/urdf/z1.urdf", None),
    "B1 with Z1": ("b1_description/urdf/b1-z1.urdf", None),
    "SO-100": ("so_arm_description/urdf/so100.urdf", None),
    "SO-101": ("so_arm_description/urdf/so101.urdf", None),
    "TIAGo": ("tiago_description/robots/tiago_no_hand.urdf", None),
    "TIAGo with hand": ("tiago_description/robots/tiago.urdf", None),
    "TIAGo Dual, left": ("tiago_description/robots/tiago_dual.urdf", "hand_left_tool_link"),
    "TIAGo Pro, left": ("tiago_pro_description/robots/tiago_pro.urdf", "arm_left_tool_link"),
    "Talos, left arm": ("talos_data/robots/talos_left_arm.urdf", None),
    "Talos, right": ("talos_data/robots/talos_reduced.urdf", "arm_right_7_link"),
    "PR2, left": ("pr2_description/urdf/pr2.urdf", "l_gripper_tool_frame"),
    "PR2, right": ("pr2_description/urdf/pr2.urdf", "r_gripper_tool_frame"),
    "Baxter, left": ("baxter_description/urdf/baxter.urdf", "left_gripper"),
    "Baxter, right": ("baxter_description/urdf/baxter.urdf", "right_gripper"),
    "Romeo, left": ("romeo_description/urdf/romeo.urdf", "l_gripper"),
    "Centauro, first": ("centauro_description/urdf/centauro.urdf", "arm1_6"),
    "Alex, left": ("alex_description/urdf/alex_nub_hands.urdf", "leftNub"),
    "G1, left": ("g1_description/urdf/g1_29dof_rev_1_0.urdf", "left_rubber_hand"),
    "G1 with hands, right": (
        "g1_description/urdf/g1_29dof_with_hand_rev_1_0.urdf",
        "right_hand_palm_link",
    ),
}

#: SRDFs of the package, of arms whose links touch where they may.
SRDFS = {
    "UR5": "ur_description/srdf/ur5.srdf",
    "PR2, left": "pr2_description/srdf/pr2.srdf",
    "PR2, right": "pr2_description/srdf/pr2.srdf",
    "Baxter, left": "baxter_description/srdf/baxter_manipulation.srdf",
    "Baxter, right": "baxter_description/srdf/baxter_manipulation.srdf",
}


def request(name: str, **more: object) -> RobotBody:
    """The upload of an arm, with ``more`` fields."""
    urdf, tip = UPLOADS[name]
    text = (package() / urdf).read_text()
    links = parse_urdf(text).links.values()
    solids = [element.geometry for link in links for element in link.collisions]
    uris = {solid.uri for solid in solids if isinstance(solid, MeshGeometry)}
    return RobotBody.model_validate(
        {
            "name": "arm",
            "urdf": text,
            "tip_link": tip,
            "default_limits": {"acceleration": "10 x velocity"},
            "meshes": {uri: base64.b64encode(mesh_bytes(uri)).decode() for uri in uris} or None,
            **more,
        }
    )


def truth_of(name: str, body: RobotBody, robot: RobotGeometry) -> Triangles:
    """The arm as triangles, joints off the chain held as the upload holds them."""
    judge = Triangles(ExampleArm(UPLOADS[name][0], robot.chain.tip_link), robot)
    held = select(parse_urdf(body.urdf or ""), body.base_link, body.tip_link).held
    judge.hold(held)
    return judge


def configurations(robot: RobotGeometry, random: np.random.Generator) -> Iterator[Array]:
    """Random configurations within the limits, at most half a turn from 0."""
    low, high = robot.chain.sampling_bounds()
    low, high = np.maximum(low, -np.pi), np.minimum(high, np.pi)
    while True:
        yield random.uniform(low, high)


def measure(name: str) -> list[str]:
    """Upload an arm and measure it: the cells of `COLUMNS`."""
    body = request(name)
    began = time.process_time()
    robot, _ = uploaded(body)
    upload = time.process_time() - began
    random = np.random.default_rng(0)
    drawn = configurations(robot, random)
    alone = Checker.of(robot, Scene())
    free = float(np.mean([alone.valid(next(drawn)) for _ in range(TRIES)]))
    tips = [link_poses(robot.chain, next(drawn), [robot.chain.tip_link])[0] for _ in range(100)]
    around = list(own_scenes(SCENES, reach_of(np.array([T[:3, 3] for T in tips]))))
    judge = truth_of(name, body, robot)
    times, tried = [], 0
    for scene in around:
        ends = free_ends(Checker.of(robot, scene), drawn)
        for start, goal in zip(ends[::2], ends[1::2], strict=False):
            tried += 1
            goals = (JointGoal(goal),)
            began = time.process_time()
            outcome = plan(Problem(robot, scene, start, goals), Options(timeout=20.0))
            if isinstance(outcome, Plan):
                times.append(time.process_time() - began)
    triangles = sum(len(body.solid.faces) for body in judge.bodies)
    closed, (wrong, count) = round_trips(robot, drawn), verdicts(robot, judge, around, drawn)
    return [
        name, str(robot.chain.n), f"`{robot.chain.tip_link}`", f"{triangles:,}", f"{upload:.1f} s",
        f"{free:.0%}", f"{len(times)} of {tried}",
        f"{median(times or [np.nan]):.2f}, {max(times or [np.nan]):.2f} s",
        f"{closed} of {ROUND_TRIPS}", f"{wrong} of {count}",
    ]  # fmt: skip


def measure_suspected(name: str) -> list[str]:
    """Upload an arm as it lies, with ``allow_suspected``, and with its SRDF.

    Returns:
        Cells of `SUSPECTED_COLUMNS`: shares of random configurations that are free of the robot.
    """
    srdf = (package() / SRDFS[name]).read_text()
    robots = [
        uploaded(request(name, **more))[0]
        for more in ({}, {"allow_suspected": True}, {"srdf": srdf})
    ]
    shares = []
    for robot in robots:
        drawn = configurations(robot, np.random.default_rng(0))
        checker = Checker.of(robot, Scene())
        shares.append(f"{np.mean([checker.valid(next(drawn)) for _ in range(STATES)]):.0%}")
    return [name, str(len(robots[0].suspected)), *shares]


def free_ends(checker: Checker, drawn: Iterator[Array]) -> list[Array]:
    """Free configurations for the problems of a scene."""
    found: list[Array] = []
    for _, q in zip(range(TRIES), drawn, strict=False):
        if len(found) < 2 * PROBLEMS and checker.valid(q):
            found.append(q)
    return found


def round_trips(robot: RobotGeometry, drawn: Iterator[Array]) -> int:
    """Poses of configurations that inverse kinematics bring the tip back to."""
    closed = 0
    for _, q in zip(range(ROUND_TRIPS), drawn, strict=False):
        T = forward(robot.chain, q)
        solutions = inverse_kinematics(robot.chain, T).solutions
        closed += any(np.abs(forward(robot.chain, s.joints) - T).max() < CLOSE for s in solutions)
    return closed


def verdicts(
    robot: RobotGeometry, judge: Triangles, scenes: list[Scene], drawn: Iterator[Array]
) -> tuple[int, int]:
    """Verdicts that differ from FCL's on the triangles, and all of them."""
    wrong = count = 0
    for scene in scenes:
        checker, bodies = Checker.of(robot, scene), scenery(scene)
        for _, q in zip(range(VERDICTS // len(scenes)), drawn, strict=False):
            count += 1
            free, meets = checker.valid(q), judge.collision(q, bodies) is not None
            if free == meets:
                wrong += free or judge.clearance(q, bodies, 1.0) > BAND
    return wrong, count


def table(columns: tuple[str, ...], rows: Iterable[Sequence[str]]) -> str:
    """Cells of rows as Markdown."""
    rule = "|" + "---|" * len(columns)
    head, *lines = ("| " + " | ".join(cells) + " |" for cells in (columns, *rows))
    return "\n".join([head, rule, *lines])


def _written(text: str, mark: str, lines: str) -> str:
    """A page with the lines between its marks replaced."""
    begin, end = BEGIN.format(mark), END.format(mark)
    before, after = text.split(begin, maxsplit=1)[0], text.split(end)[1]
    return f"{before}{begin}\n{lines}\n{end}{after}"


def main() -> None:
    """Measure, print and perhaps write the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", nargs="*", default=list(UPLOADS), choices=list(UPLOADS))
    parser.add_argument("--rows", type=Path, help="JSON of rows: kept, and not measured again")
    parser.add_argument("--write", type=Path, help="page whose tables are replaced")
    given = parser.parse_args()
    kept = json.loads(given.rows.read_text()) if given.rows and given.rows.is_file() else {}
    work: dict[str, tuple[Callable[[str], list[str]], str]] = {}
    work |= {name: (measure, name) for name in given.arms}
    touching = {name: f"suspected: {name}" for name in SRDFS}
    work |= {touching[name]: (measure_suspected, name) for name in SRDFS if name in given.arms}
    for key, (make, name) in work.items():
        if key not in kept:
            kept[key] = make(name)
            print(key, kept[key], flush=True)
            if given.rows:
                given.rows.write_text(json.dumps(kept))
    arms = table(COLUMNS, (kept[name] for name in UPLOADS if name in kept))
    suspected = table(SUSPECTED_COLUMNS, (kept[key] for key in touching.values() if key in kept))
    if given.write:
        text = given.write.read_text()
        given.write.write_text(_written(_written(text, "arms", arms), "suspected", suspected))
    else:
        print(arms, suspected, sep="\n\n")


if __name__ == "__main__":
    main()
