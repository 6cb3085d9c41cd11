"""Quick suite of an installed wheel, run by its own Python in a folder beside one named `planning`.

    python wheel_checks.py

Prints one line for each check; ends with an error at the first that fails.
"""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import armwright as aw
import planning
from armwright_client import Box, Client, Obstacle, Pose, Scene

#: The command beside the interpreter.
COMMAND = Path(sys.executable).with_name("armwright")
START = [0.8, 0.3, 0.0, -1.8, 0.0, 2.1, 0.8]
GOAL = [-0.8, 0.3, 0.0, -1.8, 0.0, 2.1, 0.8]
POST = {"id": "post", "shape": {"type": "box", "size": [0.1, 0.1, 1.0]}}
SCENE = {"obstacles": [POST | {"pose": {"position": [0.5, 0.0, 0.5]}}]}


def check_place() -> None:
    """One package is the wheel's, and names of others are free."""
    folder = Path(sys.prefix).resolve()
    assert aw.__file__ is not None
    assert Path(aw.__file__).resolve().is_relative_to(folder), aw.__file__
    assert planning.__file__ == str(Path("planning/__init__.py").resolve())
    assert aw.Problem.__module__ == "armwright._src.planning.problem"
    assert not {"kinematics", "obstacles", "service"} & {*sys.modules}


def check_library() -> None:
    """A plan past a post, proved again; a pose that inverse kinematics finds."""
    robot = aw.load_robot("panda")
    scene = aw.Scene([aw.Obstacle("post", aw.Box((0.1, 0.1, 1.0)), aw.pose([0.5, 0.0, 0.5]))])
    plan = aw.plan(robot, scene, START, GOAL)
    assert isinstance(plan, aw.Plan), plan
    assert plan.certificate.verified
    assert aw.certify(plan.trajectory, robot, scene).verified
    assert not aw.certify(plan.trajectory, robot, scene, margin=0.2).verified
    solution = aw.ik(robot, aw.fk(robot, GOAL), seed_joints=GOAL).solutions[0]
    assert abs(aw.fk(robot, solution.joints) - aw.fk(robot, GOAL)).max() < 1e-5


def check_commands() -> None:
    """A plan, its proof, a collision and the version from a shell."""
    Path("post.json").write_text(json.dumps(SCENE))
    joints = ",".join(map(str, START)), ",".join(map(str, GOAL))
    plan = ["plan", "panda", f"--start={joints[0]}", f"--goal={joints[1]}", "--scene", "post.json"]
    assert json.loads(run(0, *plan, "--json", "-o", "plan.json"))["certificate"]["verified"]
    run(0, "validate", "panda", "plan.json", "--scene", "post.json")
    run(1, "validate", "panda", "plan.json", "--scene", "post.json", "--margin", "0.2")
    ran = subprocess.run(
        [sys.executable, "-m", "armwright", "--version"], check=True, capture_output=True, text=True
    )
    assert ran.stdout.startswith("armwright "), ran.stdout


def check_server() -> None:
    """A server that plans, draws a page, and ends when it is asked to."""
    command = [str(COMMAND), "serve", "--port", "0", "--workers", "1", "--data-dir", "data"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            url = next(line.split()[-1] for line in server.stdout if "serves on" in line)
            post = Obstacle(id="post", shape=Box(size=[0.1, 0.1, 1.0]), pose=Pose.at(0.5, 0.0, 0.5))
            with Client(url) as client:
                scene = Scene(obstacles=[post])
                plan = client.plan(
                    "panda", start=START, goal=GOAL, scene=scene, keep=True, timeout=60
                )
                assert plan.certificate is not None
                assert plan.certificate.verified
                assert plan.plan_id is not None
                assert b"<html" in client.plans.view(plan.plan_id)
        finally:
            server.send_signal(signal.SIGTERM)
        assert server.wait(30) == 0


def run(code: int, *words: str) -> str:
    """Standard output of a command that ends with a code."""
    ran = subprocess.run([COMMAND, *words], check=False, capture_output=True, text=True)
    assert ran.returncode == code, f"{words}: {ran.returncode}\n{ran.stdout}\n{ran.stderr}"
    return ran.stdout


if __name__ == "__main__":
    os.environ.setdefault("ARMWRIGHT_KERNELS_FROZEN", "1")
    for check in (check_place, check_library, check_commands, check_server):
        check()
        sys.stdout.write(f"{check.__name__}: {check.__doc__}\n")
