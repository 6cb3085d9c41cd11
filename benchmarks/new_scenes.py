"""First plan in a scene that was never seen: ``python -m benchmarks.new_scenes``.

    python -m benchmarks.new_scenes [--arms panda ur5e] [--scenes 60] [--boxes 10] [--http]

Every scene is made of boxes anywhere around the arm; in it the arm goes from one random free
configuration to another. Arms of ``benchmarks.example_arms`` have their real meshes (``--meshes``),
the others are built-in. "First" is all from the scene's JSON to a proved motion: the document is
checked, its obstacles are made and packed, a way is searched and proved. "Scene" is what of that
comes before planning. "Again" is the same with all that was kept of the first time. Processor time;
with ``--http`` the clock of a client that sends the scene inline to a service with one worker.
"""

import argparse
import json
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from armwright.robot import load_robot
from armwright_client import Client, Scene
from benchmarks.example_arms import ARMS
from benchmarks.http import service, wait_until_ready
from kinematics.arrays import Array
from obstacles.checker import Checker
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene as DomainScene
from planning.options import Options
from planning.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Plan
from service.schemas.scene import Scene as SceneBody
from service.translate import poses

#: Configurations tried for two that are free.
_TRIES = 400
#: Scenes planned in before those that count.
_WARM_UP = 3
#: Limits of accelerations where a description has none [rad/s^2].
_ACCELERATION = 10.0


def document(random: np.random.Generator, count: int) -> dict[str, Any]:
    """A scene of boxes around an arm that stands at the origin, as it is on the wire."""
    obstacles = []
    for k in range(count):
        angle, away = random.uniform(-np.pi, np.pi), random.uniform(0.35, 0.9)
        place = [away * np.cos(angle), away * np.sin(angle), random.uniform(-0.1, 1.0)]
        size = random.uniform(0.05, 0.25, 3).tolist()
        shape = {"type": "box", "size": size}
        obstacles.append({"id": f"box{k}", "shape": shape, "pose": {"position": place}})
    return {"obstacles": obstacles}


def problems(
    robot: RobotGeometry, count: int, boxes: int, seed: int
) -> Iterator[tuple[dict[str, Any], Array, Array]]:
    """Documents of scenes, each with two configurations that are free in it."""
    random = np.random.default_rng(seed)
    low, high = robot.chain.sampling_bounds()
    low, high = np.maximum(low, -np.pi), np.minimum(high, np.pi)
    while count:
        body = document(random, boxes)
        checker = Checker.of(robot, read(json.dumps(body)))
        drawn = random.uniform(low, high, (_TRIES, robot.chain.n))
        ends = drawn[checker.each_valid(drawn)][:2]
        if len(ends) == 2:
            # Moved and shrunk by a micrometre, it has nothing that was seen here.
            for obstacle in body["obstacles"]:
                obstacle["pose"]["position"][0] += 1e-6
                obstacle["shape"]["size"] = [x - 4e-6 for x in obstacle["shape"]["size"]]
            yield body, ends[0], ends[1]
            count -= 1


def read(text: str) -> DomainScene:
    """The scene of a document, as a worker makes it."""
    return poses.scene(SceneBody.model_validate_json(text))


def measure(robot: RobotGeometry, asked: argparse.Namespace) -> None:
    """Print first plans and plans again of an arm."""
    rows, failed = [], 0
    drawn = problems(robot, asked.scenes + _WARM_UP, asked.boxes, asked.seed)
    for count, (body, start, goal) in enumerate(drawn):
        text, spent = json.dumps(body), []
        for _ in range(2):
            began = time.process_time()
            problem = Problem(robot, read(text), start, (JointGoal(goal),))
            made = time.process_time() - began
            answer = plan(problem, Options(timeout=asked.timeout))
            spent += [made, time.process_time() - began]
        if count < _WARM_UP:
            continue
        if not isinstance(answer, Plan):
            failed += 1
            print(f"  scene {count}: {answer.code} {answer.message}", flush=True)
            continue
        rows.append(spent)
    columns = 1e3 * np.array(rows).T
    print(f"{robot.chain.name}: {len(rows)} of {len(rows) + failed} planned; computing ms")
    for label, values in zip(("scene", "first", "scene again", "again"), columns, strict=True):
        print(f"  {label:12} {spread(values)}", flush=True)


def measure_http(name: str, asked: argparse.Namespace) -> None:
    """Print first requests and repeated ones of a built-in arm."""
    rows = []
    drawn = problems(load_robot(name), asked.scenes + _WARM_UP, asked.boxes, asked.seed)
    with service() as address, Client(address) as client:
        wait_until_ready(client)
        for body, start, goal in drawn:
            spent = []
            for _ in range(2):
                scene = Scene.model_validate(body)
                began = time.perf_counter()
                answer = client.plan(name, start, goal, scene=scene, timeout=asked.timeout)
                stages = sum(stage.milliseconds for stage in answer.stages)
                spent += [1e3 * (time.perf_counter() - began), stages]
            rows.append(spent)
    print(f"{name} over HTTP, {len(rows) - _WARM_UP} scenes sent inline; ms by the clock")
    labels = ("first", "  its stages", "again", "  its stages")
    for label, values in zip(labels, np.array(rows[_WARM_UP:]).T, strict=True):
        print(f"  {label:12} {spread(values)}", flush=True)


def spread(values: Array) -> str:
    """Median, 95 % and most."""
    return "median {:6.1f}, 95 % {:6.1f}, most {:7.1f}".format(
        *np.percentile(values, [50, 95, 100])
    )


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--arms", nargs="*", default=["panda", "ur5e"], help="built-in ones")
    parser.add_argument("--meshes", nargs="*", default=[], choices=list(ARMS))
    parser.add_argument("--scenes", type=int, default=60)
    parser.add_argument("--boxes", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--timeout", type=float, default=5.0, help="[s]")
    parser.add_argument("--http", action="store_true")
    asked = parser.parse_args()
    for name in asked.arms:
        measure(load_robot(name), asked)
        if asked.http:
            measure_http(name, asked)
    for name in asked.meshes:
        measure(ARMS[name].geometry({"acceleration": _ACCELERATION}), asked)


if __name__ == "__main__":
    main()
