"""Seams of six kinds of work for four arms, and a simple ladder to hold the planner against.

Each seam is a list of points with the surface's normal (free spin; rasters and edges with a tilt),
or of full poses. The ladder is the judge of what is possible: of each point twelve spins of the
free axis by all branches of inverse kinematics (and 24 values of a redundant parameter), those
inside the limits and free; dynamic programming over the points joins configurations of which no
joint is farther apart than half a radian, whole turns of joints with two of them left out. A seam
that the ladder follows and the planner does not is a loss.
"""

from typing import NamedTuple

import numpy as np

from benchmarks.planning.seams import STARTS
from kinematics.arrays import Array, Indices
from kinematics.ik.closed_form.analytic import branches
from kinematics.ik.closed_form.structure import structure
from kinematics.pose import from_axis_angle, from_rpy, transform
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Cylinder
from planning.problem import PoseGoal, Problem
from planning.tool_motions.tool_tolerance import SeamOptions, SeamWaypoint, ToolTolerance

KINDS = ("spiral", "raster", "sphere", "edge", "posed", "program")
ARMS = ("ur5e", "panda", "kr6_sixx", "iiwa14")
#: Spins of the ladder, and half as many as values of a redundant arm's parameter.
SPINS = 12
#: Largest step of a joint on the ladder [rad].
STEP = 0.5
#: Speed of the tool [m/s].
SPEED = 0.05
ALL_STARTS = STARTS | {"iiwa14": [0.0, 0.6, 0.0, -1.5, 0.0, 1.0, 0.0]}


class Work(NamedTuple):
    """A seam of the benchmark.

    Args:
        name: Arm, kind and round.
        seam: The request.
        spins: Whether the spin is free.
    """

    name: str
    seam: SeamOptions
    spins: bool


def points_of(kind: str, random: np.random.Generator) -> tuple[Array, Array]:
    """Points of a seam (k, 3) and the surface's normals there (k, 3), about the origin."""
    if kind == "spiral":
        turns, radius = random.uniform(1.5, 3.0), random.uniform(0.06, 0.14)
        # From 15 mm about the centre on, by steps of 4 mm.
        first = 0.015 / radius
        count = int(np.pi * turns * (1.0 + first) * radius / 0.004)
        s = np.sqrt(np.linspace(first**2, 1.0, count))
        angle = 2.0 * np.pi * turns * s
        points = np.column_stack([radius * s * np.cos(angle), radius * s * np.sin(angle), 0.0 * s])
        return points, np.tile([0.0, 0.0, 1.0], (len(s), 1))
    rows: list[Array] = []
    outs: list[Array] = []
    if kind == "raster":
        width, height = random.uniform(0.2, 0.4), random.uniform(0.1, 0.25)
        bend = random.uniform(-1.0, 1.0)
        for row in range(5):
            y = (0.25 * row - 0.5) * height
            for x in np.linspace(-0.5, 0.5, 24)[:: 1 if row % 2 == 0 else -1] * width:
                rows.append(np.array([x, y, 0.5 * bend * x * x]))
                outs.append(np.array([-bend * x, 0.0, 1.0]) / np.hypot(1.0, bend * x))
        return np.array(rows), np.array(outs)
    if kind == "sphere":
        radius, reach = random.uniform(0.1, 0.2), random.uniform(0.5, 1.2)
        s = np.linspace(0.0, 1.0, 120)
        a, b = reach * s, 4.0 * np.pi * s
        out = np.column_stack([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)])
        return radius * out - [0.0, 0.0, radius], out
    if kind == "edge":
        size = random.uniform(0.08, 0.2, 2)
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.5 * size
        for k in range(3 + int(random.integers(2))):
            first, last = corners[k % 4], corners[(k + 1) % 4]
            way = last - first
            out = np.array([way[1], -way[0], 0.0]) / np.linalg.norm(way)
            for share in np.linspace(0.02, 0.98, 16):
                rows.append(np.append(first + share * way, 0.0))
                outs.append((out + np.array([0.0, 0.0, 1.0])) / np.sqrt(2.0))
        return np.array(rows), np.array(outs)
    s = np.linspace(-0.5, 0.5, 437 if kind == "program" else 40)
    points = np.column_stack([0.1 * np.sin(3.0 * s), random.uniform(0.2, 0.5) * s, 0.0 * s])
    return points, np.tile([0.0, 0.0, 1.0], (len(s), 1))


def work(arm: str, kind: str, number: int) -> Work:
    """One seam of a kind in front of an arm."""
    random = np.random.default_rng([number, KINDS.index(kind), ARMS.index(arm)])
    points, normals = points_of(kind, random)
    R = from_rpy([*random.uniform(-0.5, 0.5, 2), random.uniform(-np.pi, np.pi)])
    out = from_axis_angle([0.0, 0.0, 1.0], random.uniform(-1.2, 1.2))
    place = out @ [random.uniform(0.38, 0.6), 0.0, random.uniform(0.05, 0.4)]
    points, normals = points @ R.T + place, normals @ R.T
    spins = kind not in {"posed", "program"}
    tilt = {"raster": np.radians(15.0), "edge": np.radians(10.0)}.get(kind)
    tolerance = ToolTolerance.of({}, ("rz",) if spins else (), tilt)
    along = points[-1] - points[0]
    poses = np.array([_pose(p, n, along) for p, n in zip(points, normals, strict=True)])
    if kind == "program":
        poses = held(poses, poses[len(poses) // 2])
    waypoints = tuple(SeamWaypoint(T, axis_only=spins) for T in poses)
    return Work(
        f"{arm} {kind} {number}", SeamOptions(waypoints, tolerance, tool_speed=SPEED), spins
    )


def held(poses: Array, T_tool: Array) -> Array:
    """Poses of the tip that holds the work of which a standing tool is to have poses (k, 4, 4).

    The work is turned as it goes along, by half a radian to either side.
    """
    swing = np.sin(np.linspace(0.0, 2.0 * np.pi, len(poses)))
    turns = np.array([transform(from_rpy([0.3 * a, 0.2 * a, 0.5 * a])) for a in swing])
    in_work = np.linalg.inv(poses[len(poses) // 2]) @ poses @ turns
    return np.asarray(T_tool @ np.linalg.inv(in_work))


def _pose(point: Array, out: Array, along: Array) -> Array:
    x = along - (along @ out) * out
    x = x if np.linalg.norm(x) > 1e-6 else np.cross(out, [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    return transform(np.column_stack([x, np.cross(-out, x), -out]), point)


def ladder(checker: Checker, seam: SeamOptions, start: Array, *, spins: bool) -> bool:
    """Whether twelve spins and all branches join the points of a seam without a jump."""
    chain = checker.model.robot.chain
    angles = np.arange(SPINS) * 2.0 * np.pi / SPINS if spins else np.zeros(1)
    turns = np.array([transform(from_axis_angle([0.0, 0.0, 1.0], a)) for a in angles])
    form, parameters = structure(chain), None
    assert form is not None
    if form.locked is not None:
        low, high = chain.sampling_bounds()
        parameters = np.linspace(low[form.locked], high[form.locked], 2 * SPINS)
    elif form.redundant:
        parameters = np.arange(2 * SPINS) * np.pi / SPINS
    lower, upper = chain.limits.lower, chain.limits.upper
    wide = upper - lower >= 4.0 * np.pi - 1.0
    before: Array | None = None
    for point in seam.waypoints:
        T = np.ascontiguousarray(point.T_base_tip @ turns)
        table = branches(chain, T, seed_joints=start, parameters=parameters)
        assert table.counts is not None
        rows = np.arange(table.table.shape[1])[None] < table.counts[:, None]
        here = table.joints[rows & table.within_limits]
        here = _with_turns(here, lower, upper, np.flatnonzero(~wide))
        if before is not None and len(here):
            steps = here[:, None] - before[None]
            steps[..., wide] -= 2.0 * np.pi * np.round(steps[..., wide] / (2.0 * np.pi))
            here = here[np.abs(steps).max(axis=2).min(axis=1) <= STEP]
        here = np.array([q for q in here if checker.valid(q)]).reshape(-1, chain.n)
        if not len(here):
            return False
        before = here
    return True


def _with_turns(joints: Array, lower: Array, upper: Array, columns: Indices) -> Array:
    """Configurations with the whole turns of some joints that their limits hold."""
    for j in columns:
        more = [joints]
        for turn in (-2.0 * np.pi, 2.0 * np.pi):
            moved = joints.copy()
            moved[:, j] += turn
            more.append(moved[(moved[:, j] >= lower[j]) & (moved[:, j] <= upper[j])])
        joints = np.concatenate(more)
    return joints


def ask(
    robot: RobotGeometry, seam: SeamOptions, start: Array, scene: Scene | None = None
) -> Problem:
    """The problem of following a seam."""
    goal = PoseGoal(seam.waypoints[-1].T_base_tip)
    return Problem(robot, scene or Scene(()), start, (goal,))


def around(seam: SeamOptions, *, posts: bool) -> Scene:
    """Two posts beside the work, 15 cm apart from its middle; nothing without posts."""
    middle = np.mean([point.T_base_tip[:3, 3] for point in seam.waypoints], axis=0)
    out = middle[:2] / np.linalg.norm(middle[:2])
    aside = 0.15 * np.array([-out[1], out[0], 0.0])
    return Scene(
        tuple(
            Obstacle(name, Cylinder(0.02, 1.0), transform(None, middle + side * aside))
            for name, side in (("left", 1.6), ("right", -1.6))
            if posts
        )
    )
