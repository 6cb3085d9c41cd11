"""Plan a seven-axis arm out of one compartment of a shelf and into another, over HTTP.

    python examples/demo.py [--output out]

Starts a service of its own on a free port, asks it for the motion through the client, prints what
each stage did and what was proved, and draws two pictures: the joints against their limits, and the
arm along its path. Exits 0 when everything was as it should be.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from armwright_client import (
    Box,
    Client,
    NotReady,
    Obstacle,
    Plan,
    Pose,
    Robot,
    Scene,
    Timing,
    TransportError,
)

Array = NDArray[np.float64]

ROBOT = "panda"
HOME = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
#: Tool poses in the lower left and the upper right compartment, looking into the shelf.
LOWER = Pose.from_rpy([0.58, 0.16, 0.32], np.pi, -np.pi / 2, 0.0)
UPPER = Pose.from_rpy([0.58, -0.16, 0.70], np.pi, -np.pi / 2, 0.0)


def shelf() -> Scene:
    """A shelf with two boards and a wall between its compartments."""
    x = 0.66
    boards = {
        "bottom": ([0.36, 0.80, 0.02], [x, 0.0, 0.10]),
        "middle": ([0.36, 0.80, 0.02], [x, 0.0, 0.50]),
        "top": ([0.36, 0.80, 0.02], [x, 0.0, 0.90]),
        "left": ([0.36, 0.02, 0.82], [x, 0.40, 0.50]),
        "wall": ([0.36, 0.02, 0.82], [x, 0.0, 0.50]),
        "right": ([0.36, 0.02, 0.82], [x, -0.40, 0.50]),
        "back": ([0.02, 0.80, 0.82], [x + 0.18, 0.0, 0.50]),
    }
    return Scene(
        name="shelf",
        obstacles=[
            Obstacle(id=name, shape=Box(size=size), pose=Pose.at(*place))
            for name, (size, place) in boards.items()
        ],
    )


@contextmanager
def service() -> Iterator[str]:
    """A service on a free port with an empty data folder; its address."""
    command = [str(Path(sys.executable).parent / "armwright"), "serve", "--port", "0"]
    # Ready once the kernels that these requests need are compiled, about half of all.
    environment = {"ARMWRIGHT_KERNELS_FIRST": "1"} | os.environ
    with tempfile.TemporaryDirectory() as folder:
        running = subprocess.Popen(
            [*command, "--data-dir", folder, "--workers", "1"],
            env=environment,
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            yield _address(running)
        finally:
            running.terminate()
            running.wait(timeout=20.0)


def _address(running: "subprocess.Popen[str]") -> str:
    assert running.stdout is not None
    for line in running.stdout:
        if "http://" in line:
            return "http://" + line.split("http://")[1].split()[0].rstrip("/.,")
    raise SystemExit("the service ended before it listened")


def wait_until_ready(client: Client, seconds: float = 300.0) -> None:
    """Kernels are compiled on the first run, which takes minutes; later runs are ready at once."""
    deadline = time.monotonic() + seconds
    while True:
        try:
            client.readyz()
        except (NotReady, TransportError):
            if time.monotonic() > deadline:
                raise
            time.sleep(0.2)
        else:
            return


def start_in_the_shelf(client: Client, robot: Robot) -> list[float]:
    """The free configuration in the lower compartment whose joints are farthest from limits."""
    answer = client.robots.ik(
        ROBOT, LOWER, scene="shelf", seed_joints=HOME, all_solutions=True, max_solutions=16,
        timeout=30.0,  # the first request to a service that has prepared nothing yet
    )  # fmt: skip
    free = [solution.joints for solution in answer.solutions if solution.collision_free]
    lower, upper = np.array(robot.limits.lower), np.array(robot.limits.upper)

    def room(joints: list[float]) -> float:
        q = np.array(joints)
        return float((np.minimum(q - lower, upper - q) / (upper - lower)).min())

    return max(free, key=room)


def tell(plan: Plan) -> None:
    """Print the stages, the motion and the proof."""
    print(f"\nPlanned by {plan.planner}:")
    for stage in plan.stages:
        print(f"  {stage.name:16} {stage.outcome:10} {stage.milliseconds:8.1f} ms  {stage.detail}")
    certificate, limits = plan.certificate, plan.certificate.limits
    print(f"\nMotion: {plan.trajectory.duration:.3f} s, {len(plan.path.joints)} waypoints")
    print(f"Verified: {certificate.verified} ({certificate.method})")
    clearance = 1e3 * (certificate.min_clearance or 0.0)
    print(f"Clearance: at least {clearance:.2f} mm at every instant, {certificate.clearance_pair}")
    for name in ("position", "velocity", "acceleration"):
        use = getattr(limits, name)
        where = f"{use.joint}, {use.time:.2f} s"
        print(f"  {name:12} {100 * use.worst_ratio:6.2f} % of its limit ({where})")


def moments(plan: Plan, count: int) -> Array:
    """Evenly spaced times over the whole motion [s]."""
    assert plan.trajectory.duration is not None
    return np.linspace(0.0, plan.trajectory.duration, count)


def draw_joints(plan: Plan, robot: Robot, file: Path) -> None:
    """Position, velocity and acceleration of every joint, each as a share of its limit."""
    times = moments(plan, 800)
    limits = robot.limits
    lower, upper = np.array(limits.lower), np.array(limits.upper)
    figure, axes = plt.subplots(3, 1, figsize=(10, 9), sharex=True, layout="constrained")
    for order, name in enumerate(("position", "velocity", "acceleration")):
        axis = axes[order]
        values = np.array(plan.trajectory.sample(times.tolist(), order))
        if order == 0:
            shares = (2.0 * values - lower - upper) / (upper - lower)
        else:
            shares = values / np.array(getattr(limits, name))
        axis.plot(times, shares, label=robot.joint_names if order == 0 else None)
        axis.axhspan(1.0, 1.15, color="tab:red", alpha=0.15)
        axis.axhspan(-1.15, -1.0, color="tab:red", alpha=0.15)
        axis.set(ylabel=f"{name} / limit", ylim=(-1.15, 1.15), xlim=(0.0, times[-1]))
        axis.grid(alpha=0.3)
    axes[0].legend(ncols=4, fontsize="small", loc="lower right")
    axes[-1].set_xlabel("time [s]")
    axes[0].set_title("Every joint against its limits (red: beyond)")
    figure.savefig(file, dpi=110)


def draw_arm(plan: Plan, client: Client, robot: Robot, scene: Scene, file: Path) -> None:
    """The arm's links along the path, and the line its tool draws, in the scene."""
    times = moments(plan, 120)
    joints = plan.trajectory.sample(times.tolist())
    frames = client.robots.fk_batch(ROBOT, joints).links
    origins = np.array([[pose.position for pose in frames[link]] for link in robot.links])
    figure = plt.figure(figsize=(14, 7), layout="constrained")
    for panel, (elevation, azimuth) in enumerate(((18, -125), (12, -178)), start=1):
        axis = figure.add_subplot(1, 2, panel, projection="3d")
        for obstacle in scene.obstacles or []:
            assert isinstance(obstacle.shape, Box)
            _draw_box(axis, np.array(obstacle.shape.size), np.array(obstacle.pose.position))
        for k in np.linspace(0, len(times) - 1, 9).astype(int):
            color = plt.colormaps["viridis"](k / len(times))
            axis.plot(*origins[:, k].T, "-o", color=color, linewidth=3, markersize=3)
        axis.plot(*origins[robot.links.index(robot.tip_link)].T, color="tab:red", linewidth=1.5)
        axis.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
        axis.set_aspect("equal")
        axis.view_init(elevation, azimuth)
    figure.suptitle("The arm along its path (start dark, goal light), its tool's line in red")
    figure.savefig(file, dpi=110)


def _draw_box(axis: Any, size: Array, center: Array) -> None:
    low, high = center - size / 2.0, center + size / 2.0
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    points = low + corners * (high - low)
    for i, a in enumerate(corners):
        for j, b in enumerate(corners[:i]):
            if np.abs(a - b).sum() == 1:
                axis.plot(*points[[i, j]].T, color="0.55", linewidth=0.8)


def main() -> None:
    """Run the demonstration."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("out"))
    output: Path = parser.parse_args().output
    mpl.use("Agg")
    output.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    with service() as address, Client(address) as client:
        print(f"Serving on {address}; the first run compiles its kernels, which takes a while.")
        wait_until_ready(client)
        print(f"Ready after {time.monotonic() - began:.1f} s.")
        scene = shelf()
        client.scenes.create(scene)
        robot = client.robots.get(ROBOT)
        start = start_in_the_shelf(client, robot)
        asked = time.monotonic()
        plan = client.plan(
            ROBOT, start, UPPER, scene="shelf", timeout=20.0, timing=Timing(sample_period=0.01)
        )
        print(f"Answered in {1e3 * (time.monotonic() - asked):.0f} ms over HTTP.")
        tell(plan)
        draw_joints(plan, robot, output / "demo_joints.png")
        draw_arm(plan, client, robot, scene, output / "demo_arm.png")
    if not plan.certificate.verified:
        raise SystemExit("the motion was not verified")
    print(f"\nPictures: {output / 'demo_joints.png'}, {output / 'demo_arm.png'}")


if __name__ == "__main__":
    main()
