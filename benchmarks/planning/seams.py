"""Seams on lines, arcs, cylinders, spheres and a saddle, followed by four arms and judged densely.

    python -m benchmarks.planning.seams [--seams 13] [--arms panda ur5e kr6_sixx iiwa_rail]
        [--length 1.0]

For each arm ``--seams`` times five shapes with two tolerances in turn: welding (free spin, tilt of
5 degrees) and painting (free spin, tilt of 15 degrees), 200 waypoints each, past a post beside the
work. With ``--length`` all seams are as long as that, and the post stands farther from the work.

The judge is pinocchio's forward kinematics for the tool (distance from the polyline, tilt) and
python-fcl for collisions, at times that are no multiple of anything.
"""

import argparse
import time
from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pinocchio

from benchmarks.judges.fcl import FclJudge
from kinematics.arrays import Array
from kinematics.pose import transform
from kinematics.robots import builtin_srdf, builtin_urdf
from kinematics.tree.serial_chain import serial_chain
from kinematics.tree.srdf import parse_srdf
from kinematics.urdf.urdf import parse_urdf
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Cylinder
from planning.options import CartesianOptions, Options
from planning.pipeline.pipeline import plan
from planning.problem import PoseGoal, Problem
from planning.result import Plan
from planning.tool_motions.tool_tolerance import SeamOptions, SeamWaypoint, ToolTolerance

#: Speed of the tool [m/s].
SPEED = 0.1
#: Deviation that counts as unclean: of the tool [m], and of its axis beyond the tolerance [rad].
POSITION, ORIENTATION = 1e-4, 1e-3
STARTS = {
    "panda": [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785],
    "ur5e": [0.2, -1.2, 1.5, -1.9, -1.57, 0.2],
    "kr6_sixx": [0.1, -1.2, 1.5, 0.1, 1.2, 0.1],
    "iiwa_rail": [0.0, 0.1, 0.6, 0.0, -1.5, 0.1, 1.0, 0.0],
}
_RAIL = """<link name="rail"/><joint name="rail_joint" type="prismatic"><parent link="rail"/>
<child link="iiwa_link_0"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1000"/></joint>"""


class Arm(NamedTuple):
    """An arm with pinocchio's model of it."""

    robot: RobotGeometry
    urdf: str
    model: pinocchio.Model
    data: pinocchio.Data
    frame: int


def load(name: str) -> Arm:
    """An arm of the benchmark."""
    urdf = builtin_urdf("iiwa14" if name == "iiwa_rail" else name)
    semantics, limits = None, None
    if name == "iiwa_rail":
        urdf = urdf.replace("</robot>", _RAIL + "</robot>")
        limits = {"rail_joint": {"acceleration": 2.0, "jerk": 50.0}}
        for k in range(1, 8):
            limits[f"iiwa_joint_{k}"] = {"acceleration": 8.0, "jerk": 500.0}
    else:
        semantics = parse_srdf(builtin_srdf(name))
    description = parse_urdf(urdf)
    chain = serial_chain(description, semantics=semantics, joint_limits=limits)
    model = pinocchio.buildModelFromXML(urdf)
    robot = robot_geometry(chain, description, {}, semantics)
    return Arm(robot, urdf, model, model.createData(), model.getFrameId(chain.tip_link))


#: Waypoints of a seam.
WAYPOINTS = 200
#: Instants that the judge looks at.
INSTANTS = 701
SHAPES = ("line", "arc", "cylinder", "sphere", "saddle")


class Verdict(NamedTuple):
    """Judgement of one plan: largest distance [m], tilt [rad], and whether it collides."""

    away: float
    tilt: float
    collides: bool


def seam(
    shape: str, random: np.random.Generator, length: float | None = None
) -> tuple[SeamWaypoint, ...]:
    """A seam in front of an arm, the tool's z into the surface.

    Args:
        shape: One of ``SHAPES``.
        random: Where it is, and how much it bends.
        length: Of it [m]; 0.3 m to 0.5 m, as it comes, if None.
    """
    s = np.linspace(-1.0, 1.0, WAYPOINTS)
    x, y, z = 0.42 + random.uniform(0.0, 0.12), random.uniform(-0.12, 0.12), 0.2
    z += random.uniform(0.0, 0.15)
    bend = random.uniform(-0.06, 0.06)
    if shape == "line":
        points = np.column_stack([x + 0.3 * bend * s, y + 0.25 * s, z + 0 * s])
        out = np.tile([0.0, 0.0, 1.0], (WAYPOINTS, 1))
    elif shape == "arc":
        angle = s * random.uniform(1.0, 2.5)
        points = np.column_stack([x + 0.1 * np.cos(angle), y + 0.1 * np.sin(angle), z + 0 * s])
        out = np.tile([0.0, 0.0, 1.0], (WAYPOINTS, 1))
    elif shape == "cylinder":
        angle, radius = 0.5 * s, 0.35
        out = np.column_stack([0 * s, np.sin(angle), np.cos(angle)])
        points = [x, y, z - radius] + radius * out + np.outer(bend * np.sin(2 * s), [1.0, 0, 0])
    elif shape == "sphere":
        a, b, radius = 0.6 * s, 4.0 * bend * np.cos(2.0 * s), 0.3
        out = np.column_stack([np.sin(b), np.cos(b) * np.sin(a), np.cos(b) * np.cos(a)])
        points = [x, y, z - radius] + radius * out
    else:
        u, v = bend * np.sin(2.0 * s), 0.22 * s
        points = np.column_stack([x + u, y + v, z + 1.5 * (u**2 - v**2)])
        out = np.column_stack([-3.0 * u, 3.0 * v, np.ones(WAYPOINTS)])
        out /= np.linalg.norm(out, axis=1)[:, None]
    if length is not None:
        # The same surface at another scale, about the middle of the seam: normals stay.
        ways = np.linalg.norm(np.diff(points, axis=0), axis=1)
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        points = middle + length / ways.sum() * (points - middle)
    along = np.gradient(points, axis=0)
    return tuple(_waypoint(p, n, t) for p, n, t in zip(points, out, along, strict=True))


def _waypoint(point: Array, out: Array, along: Array) -> SeamWaypoint:
    x = along - (along @ out) * out
    x /= np.linalg.norm(x)
    return SeamWaypoint(transform(np.column_stack([x, np.cross(-out, x), -out]), point))


def problems(
    name: str, arm: Arm, count: int, length: float | None = None
) -> Iterator[tuple[Problem, SeamOptions]]:
    """Problems of seams past a post, shapes and tolerances in turn.

    Args:
        name: Name of the arm.
        arm: Arm that follows them.
        count: Number of the seams.
        length: Length of all seams [m]; 0.3 m to 0.5 m, as it comes, if None.
    """
    place = [0.45, 0.45, 0.4] if length is None else [0.0, 0.6, 0.4]
    scene = Scene((Obstacle("post", Cylinder(0.03, 0.8), transform(None, place)),))
    random, start = np.random.default_rng(7), np.array(STARTS[name])
    for k in range(count):
        points = seam(SHAPES[k % len(SHAPES)], random, length)
        tolerance = ToolTolerance.of({}, ("rz",), np.radians(5.0 if k % 2 else 15.0))
        goal = PoseGoal(points[-1].T_base_tip)
        asked = SeamOptions(points, tolerance, tool_speed=SPEED)
        yield Problem(arm.robot, scene, start, (goal,)), asked


def judge(arm: Arm, scene: Scene, waypoints: tuple[SeamWaypoint, ...], answer: Plan) -> Verdict:
    """Distance and tilt of the tool along a seam, and collisions of the whole motion."""
    fcl, motion = FclJudge(arm.robot, scene), answer.trajectory
    p = np.array([point.T_base_tip for point in waypoints])
    ways = np.diff(p[:, :3, 3], axis=0)
    square = (ways**2).sum(axis=1)
    begins = answer.tool_motions[0].begins
    away, tilt, collides = 0.0, 0.0, False
    for t in np.linspace(0.0, motion.duration, INSTANTS):
        q = motion.sample([t])[0]
        collides = collides or fcl.collides(q)
        if t < begins:
            continue
        pinocchio.framesForwardKinematics(arm.model, arm.data, q)
        T = arm.data.oMf[arm.frame]
        off = T.translation - p[:-1, :3, 3]
        s = np.clip((off * ways).sum(axis=1) / square, 0.0, 1.0)
        distances = np.linalg.norm(off - s[:, None] * ways, axis=1)
        k = int(np.argmin(distances))
        axis = (1.0 - s[k]) * p[k, :3, 2] + s[k] * p[k + 1, :3, 2]
        cosine = float(axis @ T.rotation[:, 2]) / float(np.linalg.norm(axis))
        away, tilt = max(away, float(distances[k])), max(tilt, float(np.arccos(min(1.0, cosine))))
    return Verdict(away, tilt, collides)


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description="Seams followed by arms.")
    parser.add_argument("--seams", type=int, default=13)
    parser.add_argument("--arms", nargs="+", default=list(STARTS), choices=list(STARTS))
    parser.add_argument("--length", type=float, help="of all seams [m]")
    chosen = parser.parse_args()
    for name in chosen.arms:
        _measure(name, chosen.seams * len(SHAPES), chosen.length)


def _measure(name: str, count: int, length: float | None) -> None:
    arm, times, shares, unclean = load(name), [], [], 0
    reasons: Counter[str] = Counter()
    for problem, asked in problems(name, arm, count, length):
        how = CartesianOptions(seam=asked)
        began, computed = time.perf_counter(), time.process_time()
        answer = plan(problem, Options(planner="cartesian", cartesian=how, timeout=20.0))
        taken = time.perf_counter() - began, time.process_time() - computed
        if not isinstance(answer, Plan):
            reasons[str(answer.details.get("reason", answer.code))] += 1
            continue
        times.append(taken)
        assert answer.certificate.tool_speed is not None
        shares.append(answer.certificate.tool_speed.share)
        verdict = judge(arm, problem.scene, asked.waypoints, answer)
        tilted = verdict.tilt > asked.tolerance.tilt + ORIENTATION
        unclean += verdict.away > POSITION or tilted or verdict.collides
    print(f"{name}: {len(times)} of {count} followed, {unclean} unclean, failures {dict(reasons)}")
    if times:
        wall, processor = 1e3 * np.array(times).T
        print(
            f"  answer: median {np.median(wall):.0f} ms, 95 % {np.quantile(wall, 0.95):.0f} ms; "
            f"processor time: median {np.median(processor):.0f} ms"
        )
        print(f"  share within the band: median {np.median(shares):.3f}, least {min(shares):.3f}")


if __name__ == "__main__":
    main()
