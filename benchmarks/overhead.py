"""Time that a plan costs beyond planning: in the client, the server, the worker, and as JSON.

    python -m benchmarks.overhead [--rounds 30] [--scenes none stored inline moveit moveit_again]

A client with one connection asks a server with one worker for the plans that this process makes of
the same problems with `planning.pipeline.pipeline.plan`; in each round it plans eight
motions, then asks for them. The built-in Panda moves among ten boxes:

* ``none``: without them; ``stored``: in a scene that is stored, and named by requests;
* ``inline``: each request brings them, as obstacles, of which one has a new name;
  ``inline_again``: always the same;
* ``moveit``: as the text of a MoveIt planning scene, with such a name; ``moveit_again``: always the
  same.

Where a request brings a scene that was never seen, this process plans in a new one, too: whatever
planning prepares for a scene is no part of the difference. Beside the differences of medians by
the clock stand the processor times of a request in client, server and worker; the latter is told
less that of planning in this process.
"""

import argparse
import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from armwright.robot import load_robot
from armwright_client import Box, Client, Obstacle, Pose
from armwright_client import Scene as SceneBody
from benchmarks.server.machines import local_server, processor_times, wait_until_idle
from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle as DomainObstacle
from obstacles.scenes.scene import Scene
from obstacles.shapes import shape
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Plan

#: Around this state the hand is in front of the arm.
MIDDLE = np.array([0.0, -0.3, 0.0, -2.2, 0.0, 2.0, 0.785])
#: How far states are from it at most, joint by joint [rad].
SPREAD = np.array([1.2, 0.5, 0.4, 0.5, 0.4, 0.5, 1.0])
MOTIONS = 8
#: Least distance of starts and goals from boxes [m].
CLEARANCE = 0.03
SCENES = ("none", "stored", "inline", "inline_again", "moveit", "moveit_again")
#: Of what was never seen.
_NUMBERS = itertools.count(1)
_COLUMNS = ("in process", "over HTTP", "difference", "client", "server", "worker")
_OBJECT = """\
    - id: {id}
      header: {{frame_id: panda_link0}}
      primitives:
        - type: box
          dimensions: {size}
      primitive_poses:
        - position: {position}
          orientation: [0, 0, 0, 1]
"""


@dataclass(frozen=True)
class Spent:
    """Times of one plan.

    Args:
        clock: Until it was there [s].
        processor: Of this process [s].
        path: What was found.
    """

    clock: float
    processor: float
    path: list[list[float]]


def boxes(table: str = "table") -> list[tuple[str, list[float], list[float]]]:
    """Name, size and position of each box: a table, and what stands around on it [m]."""
    random = np.random.default_rng(4)
    found = [(table, [1.0, 1.6, 0.04], [0.7, 0.0, -0.1])]
    for index in range(9):
        angle, reach = random.uniform(-1.3, 1.3), random.uniform(0.45, 0.8)
        size = random.uniform([0.05, 0.05, 0.1], [0.15, 0.15, 0.4]).round(3)
        place = [reach * np.cos(angle), reach * np.sin(angle), -0.08 + size[2] / 2]
        found.append((f"box_{index}", size.tolist(), np.round(place, 3).tolist()))
    return found


def moveit_text(title: str) -> str:
    """The boxes as the text of a MoveIt planning scene."""
    objects = "".join(_OBJECT.format(id=name, size=s, position=p) for name, s, p in boxes(title))
    return f"name: {title}\nrobot_model_name: panda\nworld:\n  collision_objects:\n{objects}"


def scene(table: str = "table") -> Scene:
    """The boxes as a scene that is not prepared yet."""
    return Scene(
        tuple(DomainObstacle(name, shape.Box(s), _pose(place)) for name, s, place in boxes(table))
    )


def _pose(position: list[float]) -> Array:
    T = np.eye(4)
    T[:3, 3] = position
    return T


def scene_body(name: str | None, table: str = "table") -> SceneBody:
    """The boxes as requests have them."""
    obstacles = [
        Obstacle(id=box, shape=Box(size=size), pose=Pose(position=place))
        for box, size, place in boxes(table)
    ]
    return SceneBody(name=name, obstacles=obstacles)


def motions(robot: RobotGeometry) -> list[tuple[Array, Array]]:
    """Starts and goals that keep clear of the boxes, and between which there is a motion."""
    random, cell = np.random.default_rng(1), scene()
    checker, found = Checker.of(robot, cell, CLEARANCE), list[tuple[Array, Array]]()
    while len(found) < MOTIONS:
        ends = (MIDDLE + SPREAD * random.uniform(-1.0, 1.0, (2, 7))).round(6)
        is_free = all(checker.valid(q) for q in ends)
        if is_free and isinstance(plan(_problem(robot, cell, ends[0], ends[1]), Options()), Plan):
            found.append((ends[0], ends[1]))
    return found


def _problem(robot: RobotGeometry, cell: Scene, start: Array, goal: Array) -> Problem:
    return Problem(robot, cell, start, (JointGoal(goal),))


def spent_inside(problem: Problem) -> Spent:
    """Plan in this process."""
    began, spent = time.perf_counter(), time.process_time()
    answer = plan(problem, Options())
    clock, processor = time.perf_counter() - began, time.process_time() - spent
    assert isinstance(answer, Plan)
    return Spent(clock, processor, answer.path.waypoints.tolist())


def spent_outside(
    client: Client, start: list[float], goal: list[float], body: SceneBody | str | None
) -> Spent:
    """Have a plan made over HTTP."""
    began, spent = time.perf_counter(), time.process_time()
    if body is None:
        answer = client.plan("panda", start, goal)
    else:
        answer = client.plan("panda", start, goal, scene=body)
    clock, processor = time.perf_counter() - began, time.process_time() - spent
    return Spent(clock, processor, answer.path.joints)


def bodies(kind: str) -> Callable[[], SceneBody | str | None]:
    """A function that gives the scene of each request in turn."""
    if kind == "none":
        return lambda: None
    if kind == "stored":
        return lambda: "boxes"
    names = map("table_{}".format, itertools.repeat(0) if kind.endswith("again") else _NUMBERS)
    if kind.startswith("inline"):
        return lambda: scene_body(None, next(names))
    return lambda: SceneBody(moveit=moveit_text(next(names)))


def cells(kind: str) -> Iterator[Scene]:
    """The scene of each problem, new where requests bring theirs."""
    kept = Scene() if kind == "none" else scene()
    while True:
        yield scene(f"own_{next(_NUMBERS)}") if kind in ("inline", "moveit") else kept


def measure(kind: str, client: Client, pid: int, robot: RobotGeometry, rounds: int) -> str:
    """Plan all motions both ways in each round, and give a line of the table."""
    moves, body, cell = motions(robot), bodies(kind), cells(kind)
    inside: list[Spent] = []
    outside: list[Spent] = []
    server = workers = 0.0
    for number in range(rounds + 1):
        if number == 1:  # in the first one caches filled
            inside, outside, server, workers = [], [], 0.0, 0.0
        problems = [_problem(robot, next(cell), *ends) for ends in moves]
        inside += [spent_inside(problem) for problem in problems]
        requests = [(start.tolist(), goal.tolist(), body()) for start, goal in moves]
        before = processor_times(pid)
        outside += [spent_outside(client, *request) for request in requests]
        spent = processor_times(pid).since(before)
        server += spent.own
        workers += spent.below
    assert [one.path for one in inside] == [one.path for one in outside]
    here, there = (np.array([one.clock for one in part]) for part in (inside, outside))
    # Motion by motion: they take different times.
    medians = [np.median(there[k::MOTIONS]) - np.median(here[k::MOTIONS]) for k in range(MOTIONS)]
    client_time = np.median([one.processor for one in outside])
    worker = (workers - sum(one.processor for one in inside)) / len(outside)
    told = 1e3 * np.array(
        [np.median(here), np.median(there), np.median(medians), client_time,
         server / len(outside), worker]
    )  # fmt: skip
    return f"{kind:13}" + "".join(
        f"{value:{len(name) + 2}.2f}" for name, value in zip(_COLUMNS, told, strict=True)
    )


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=30)
    parser.add_argument("--scenes", nargs="+", default=SCENES, choices=SCENES)
    asked = parser.parse_args()
    robot = load_robot("panda")
    with local_server({"ARMWRIGHT_WORKERS": "1"}) as (pid, url), Client(url) as client:
        wait_until_idle(pid)
        client.scenes.replace("boxes", scene_body("boxes"))
        print(f"{'[ms]':13}" + "".join(f"  {name}" for name in _COLUMNS))
        for kind in asked.scenes:
            print(measure(kind, client, pid, robot, asked.rounds), flush=True)


if __name__ == "__main__":
    main()
