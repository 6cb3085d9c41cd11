"""What HTTP and the worker cost: the same problems planned in this process and over HTTP.

    python -m benchmarks.http ../data/mbm/panda [--every 10]

The robot is uploaded as it lies in ``../../panda`` (URDF, SRDF, collision meshes), the scenes as
MoveIt texts. Both ways plan with the same seed; problems alternate between them, and the difference
is taken problem by problem. A worker is a process of its own: its caches start cold, so one round
is run before what is counted.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from armwright_client import Client, JointLimits, RobotUpload, Scene
from benchmarks.mbm_problems import ACCELERATION, cases, panda
from benchmarks.server.machines import local_server
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.result import Plan


def upload(folder: Path) -> RobotUpload:
    """The robot as it lies there, with the accelerations of the manufacturer's data sheet."""
    limits = {
        f"panda_joint{i}": JointLimits(acceleration=a) for i, a in enumerate(ACCELERATION, start=1)
    }
    return RobotUpload.from_urdf(
        folder / "panda.urdf",
        name="uploaded_panda",
        srdf=folder / "panda.srdf",
        package_dirs=[folder],
        joint_limits=limits,
    )


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("--every", type=int, default=10)
    asked = parser.parse_args()
    folder = asked.problems.parent.parent / "panda"
    robot = panda(folder)
    rows: list[tuple[float, float, float]] = []
    with local_server({"ARMWRIGHT_WORKERS": "1"}) as (_, address), Client(address) as client:
        client.robots.create(upload(folder))
        chosen = list(cases(asked.problems, robot.chain.joint_names, asked.every))
        for count, case in enumerate(chosen):
            client.scenes.create(Scene(name=f"scene_{count}", moveit=case.text))
        for counted in (False, True):
            for count, case in enumerate(chosen):
                problem = case.problem(robot, 0.0)
                began = time.perf_counter()
                here = plan(problem, Options())
                inside = time.perf_counter() - began
                began = time.perf_counter()
                there = client.plan(
                    "uploaded_panda", case.start, case.goal, scene=f"scene_{count}", timeout=5.0
                )
                outside = time.perf_counter() - began
                assert isinstance(here, Plan), case.name
                assert there.path.joints == here.path.waypoints.tolist(), case.name
                stages = sum(stage.milliseconds for stage in there.stages)
                if counted:
                    rows.append((1e3 * inside, 1e3 * outside, stages))
    inside_ms, outside_ms, stages_ms = np.array(rows).T
    print(f"{len(rows)} problems, each planned both ways with the same path as a result")
    print("                                   median     p95   [ms]")
    for label, values in (
        ("in process", inside_ms),
        ("over HTTP", outside_ms),
        ("difference", outside_ms - inside_ms),
        ("over HTTP less its own stages", outside_ms - stages_ms),
    ):
        print(f"{label:30} {np.median(values):10.1f} {np.percentile(values, 95):7.1f}")


if __name__ == "__main__":
    main()
