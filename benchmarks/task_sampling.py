"""Pick and place as MoveIt's task constructor goes about it, with OMPL and FCL: peer and witness.

Stages propose and stages connect: grasps are taken in their order with the branches of inverse
kinematics, straight motions are led in steps of the tool with a collision check at each, for the
place before the first free motion is looked for. RRT-Connect of OMPL joins what is free, what is
near before what is far. FCL checks configurations, motions at many points.
Nothing of the search for tasks, its checker, its planners or its proof is used; what it finds is
neither timed nor proved.
"""

import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from ompl import base, geometric, util

from benchmarks.fcl_judge import FclJudge
from kinematics.arrays import Array
from kinematics.chain import Chain
from kinematics.forward import forward
from kinematics.ik.analytic import branches
from kinematics.ik.inverse import CLOSE
from kinematics.ik.structure import structure
from kinematics.jacobian import pose_and_jacobian
from kinematics.pose import inverse
from kinematics.trajectory import Trajectory
from planning.sampling.space import joint_space, state_of
from planning.sequence.node import contact_pairs
from planning.sequence.stage import Grasp, Pair, Place, Straight
from planning.sequence.task import Task
from planning.sequence.world import Cells, Contact, World

#: Steps of the tool along a line [m], and the largest change of a joint in one [rad].
_STEP, _JUMP = 5e-3, 0.3
#: Distance of joints between checks of a free motion [rad], and OMPL's range [rad].
_RESOLUTION, _RANGE = 0.02, 0.8
#: Values of a redundant arm's parameter.
_PARAMETERS = 12
#: Ways to put the object down at one place.
_PUTS = 4
#: Longest processor time for one free motion [s].
_CONNECT = 1.0
#: Speed along the way in the motions that are looked at densely [rad/s].
_SPEED = 1.0


@dataclass(frozen=True)
class Leg:
    """One motion of an answer, as the dense check reads a stage.

    Args:
        after: The world in it.
        allowed: Pairs that may touch.
        trajectory: Its way at an even speed.
        index: Number of the stage.
        kind: Its kind.
    """

    after: World
    allowed: tuple[Pair, ...]
    trajectory: Trajectory
    index: int
    kind: str


class _SurfaceJudge(FclJudge):
    """FCL's own verdict, as MoveIt has it: what is wholly inside a mesh is not found."""

    def _holds(self, a: int, b: int) -> bool:  # noqa: ARG002
        return False


class _Place(NamedTuple):
    """A world with the pairs that may touch in it, and who judges configurations there."""

    world: World
    allowed: tuple[Pair, ...]
    judge: _SurfaceJudge


class _Put(NamedTuple):
    """A way to put the object down, and to leave it.

    Args:
        down: Where it is put down.
        way_in: The way there, shape (k, n).
        leaving: Where it stands.
        out: The way away from it, shape (k, n).
    """

    down: _Place
    way_in: Array
    leaving: _Place
    out: Array


@dataclass
class SampledTask:
    """One task: move, approach, grasp, close, attach, lift, move, approach, place, ... retreat.

    Args:
        task: Its stages in this order, as the benchmark makes them.
        seed: Of OMPL.
        timeout: For everything, of processor time [s].
    """

    task: Task
    seed: int
    timeout: float

    def __post_init__(self) -> None:
        self._ends = time.thread_time() + self.timeout
        self._cells = Cells()
        util.RNG.setSeed(self.seed + 1)

    def solve(self) -> list[Leg] | None:
        """The motions of the first combination that can be done; None where time was up."""
        grasp = self.task.stages[2]
        assert isinstance(grasp, Grasp)
        world, name = self.task.world, grasp.object
        free = self._place(world, ())
        near = self._place(world, contact_pairs(grasp))
        T_object = world.scene.obstacle(name).T_world_obstacle
        for frame in grasp.frames:
            goals = self._candidates(T_object @ frame, near, self.task.start)
            if not goals:
                continue
            there = world.after_grasp(Contact(name, frame), contact_pairs(grasp))
            held = there.after_attach(name, None, ((), grasp.touch_depth), None, goals[0])
            lifting = self._place(held, self.task.stages[5].settings.allowed)
            puts: list[_Put] | None = None
            for q in goals:
                way_in = self._line(near, q, self._straight(1), backwards=True)
                up = None if way_in is None else self._line(lifting, q, self._straight(5))
                if way_in is None or up is None:
                    continue
                carried = held.after_motion(free=True)
                puts = self._puts(carried, up[-1]) if puts is None else puts
                moves = self._connect(free, self.task.start, way_in[0]) if puts else None
                last = None if moves is None else self._carry(carried, up[-1], puts)
                if moves is not None and last is not None:
                    return [_leg(free, moves, 0, "move"), _leg(near, way_in, 1, "approach"),
                            _leg(lifting, up, 5, "lift"), *last]  # fmt: skip
                if not puts or time.thread_time() > self._ends:
                    break
        return None

    def _carry(self, held: World, q_lifted: Array, puts: list["_Put"]) -> list[Leg] | None:
        """The motions from the lift on, to the first way to put it down that is reached."""
        carrying = self._place(held, ())
        for put in sorted(puts, key=lambda put: _distance(q_lifted, put.way_in[0])):
            moves = self._connect(carrying, q_lifted, put.way_in[0])
            if moves is not None:
                return [_leg(carrying, moves, 6, "move"), _leg(put.down, put.way_in, 7, "approach"),
                        _leg(put.leaving, put.out, 11, "retreat")]  # fmt: skip
        return None

    def _puts(self, held: World, q_lifted: Array) -> list["_Put"]:
        """Ways to put the object down and to leave it, few of each place."""
        place = self.task.stages[8]
        assert isinstance(place, Place)
        name, puts = str(place.object), []
        down = self._place(held, place.settings.allowed)
        tools = place.poses @ inverse(held.T_tool_object(name))
        for T, pose in zip(tools, place.poses, strict=True):
            leaving, count = None, 0
            for q in self._candidates(T, down, q_lifted):
                way_in = self._line(down, q, self._straight(7), backwards=True)
                if way_in is None or count == _PUTS:
                    continue
                if leaving is None:
                    stands = held.after_place(Contact(name, pose)).after_detach(name, ((), 0.0), q)
                    leaving = self._place(stands, ())
                out = self._line(leaving, q, self._straight(11))
                if out is not None:
                    count += 1
                    puts.append(_Put(down, way_in, leaving, out))
        return puts

    def _straight(self, k: int) -> Straight:
        stage = self.task.stages[k]
        assert isinstance(stage, Straight)
        return stage

    def _place(self, world: World, allowed: Iterable[Pair]) -> _Place:
        cell = self._cells.cell(world, allowed)
        pairs = tuple(sorted(cell.scene.allowed_collisions))
        return _Place(world, pairs, _SurfaceJudge(cell.robot, cell.scene))

    def _candidates(self, T: Array, where: _Place, near: Array) -> list[Array]:
        """Configurations whose tool is at a pose and which FCL finds free, the nearest first."""
        rows = sorted(_branches(self.task.world.robot.chain, T), key=lambda q: _distance(near, q))
        return [q for q in rows if time.thread_time() < self._ends and not where.judge.collides(q)]

    def _line(
        self, where: _Place, q: Array, stage: Straight, *, backwards: bool = False
    ) -> Array | None:
        """Configurations along the longest free line, shape (k, n); None where it is too short."""
        chain, limits = self.task.world.robot.chain, self.task.world.robot.chain.limits
        T = forward(chain, q)
        along = T[:3, :3] @ stage.direction if stage.frame == "tool" else stage.direction
        along = -along if backwards else along
        rows, count = [q], round(stage.most / _STEP)
        for k in range(1, count + 1):
            goal = T.copy()
            goal[:3, 3] += k * _STEP * along
            new = _follow(chain, rows[-1], goal)
            inside = new is not None and bool(((new >= limits.lower) & (new <= limits.upper)).all())
            if new is None or not inside or where.judge.collides(new):
                break
            rows.append(new)
        if (len(rows) - 1) * _STEP < stage.least:
            return None
        return np.array(rows[::-1] if backwards else rows)

    def _connect(self, where: _Place, start: Array, goal: Array) -> Array | None:
        """A free motion, shape (k, n); None where none is found in time."""
        chain = self.task.world.robot.chain
        space = joint_space(chain, [start, goal])
        setup = geometric.SimpleSetup(space)
        information = setup.getSpaceInformation()
        information.setStateValidityChecker(
            lambda state: not where.judge.collides(np.array(state[0 : chain.n]))
        )
        information.setStateValidityCheckingResolution(_RESOLUTION / space.getMaximumExtent())
        setup.setStartAndGoalStates(state_of(space, start), state_of(space, goal))
        planner = geometric.RRTConnect(information)
        planner.setRange(_RANGE)
        setup.setPlanner(planner)
        ends = min(time.thread_time() + _CONNECT, self._ends)
        setup.solve(base.PlannerTerminationCondition(lambda: time.thread_time() > ends))
        if not setup.haveExactSolutionPath():
            return None
        states = setup.getSolutionPath().getStates()
        return np.array([state[0 : chain.n] for state in states], dtype=np.float64)


def with_grips(task: Task, grips: Array, places: Array) -> Task:
    """The task with other grasps and places.

    Args:
        task: The task.
        grips: T_object_tool of each grasp, shape (k, 4, 4).
        places: Poses of the object, shape (k, 4, 4).
    """
    stages = list(task.stages)
    grasp, place = stages[2], stages[8]
    assert isinstance(grasp, Grasp)
    assert isinstance(place, Place)
    stages[2], stages[8] = replace(grasp, frames=grips), replace(place, poses=places)
    return Task(task.world, task.start, tuple(stages), task.seed)


def _branches(chain: Chain, T: Array) -> Array:
    """Configurations inside the limits whose tool is at a pose, shape (k, n)."""
    form = structure(chain)
    assert form is not None
    low, high = chain.sampling_bounds()
    values = None
    if form.redundant and form.locked is not None:
        values = np.linspace(low[form.locked], high[form.locked], _PARAMETERS + 2)[1:-1]
    elif form.redundant:
        values = np.arange(_PARAMETERS) * 2.0 * np.pi / _PARAMETERS - np.pi
    table = branches(chain, T[None], parameters=values, tolerance=CLOSE, threads=1)
    assert table.counts is not None
    count = int(table.counts[0])
    rows = table.table[0, :count]
    return np.asarray(rows[table.within_limits[0, :count], : chain.n])


def _follow(chain: Chain, q: Array, goal: Array) -> Array | None:
    """The configuration near ``q`` whose tool is at a pose, by Newton's method."""
    new = q.copy()
    for _ in range(6):
        T, J = pose_and_jacobian(chain, new)
        turn = goal[:3, :3] @ T[:3, :3].T
        twist = 0.5 * np.array(
            [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
        )
        error = np.concatenate([goal[:3, 3] - T[:3, 3], twist])
        if np.abs(error).max() < 1e-6:
            return new if np.abs(new - q).max() < _JUMP else None
        new = new + np.linalg.pinv(J, rcond=1e-4) @ error
    return None


def _distance(a: Array, b: Array) -> float:
    """Largest change of a joint."""
    return float(np.abs(a - b).max())


def _leg(where: _Place, rows: Array, index: int, kind: str) -> Leg:
    steps = np.maximum(np.linalg.norm(np.diff(rows, axis=0), axis=1), 1e-6) / _SPEED
    breaks = np.concatenate([[0.0], np.cumsum(steps)])
    speeds = np.diff(rows, axis=0) / steps[:, None]
    coefficients = np.stack([rows[:-1], speeds], axis=2)
    names = where.world.robot.chain.joint_names
    return Leg(where.world, where.allowed, Trajectory(names, breaks, coefficients), index, kind)
