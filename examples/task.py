"""Pick a crate, whichever grasp serves, put it behind a wall wherever it fits, and go home.

    armwright serve &
    python examples/task.py [--url http://127.0.0.1:8000] [--picture tasks.svg]

One request: eighteen grasps all around the crate, places on a rectangle behind the wall. The answer
has a proved motion for each stage. The picture shows the scene from the front with the tool's path.
"""

import argparse
from pathlib import Path

import numpy as np

from armwright_client import (
    ApproachStage,
    AttachStage,
    Box,
    Client,
    CloseStage,
    DetachStage,
    Goal,
    GraspRegion,
    GraspStage,
    LiftStage,
    MoveStage,
    Obstacle,
    OpenStage,
    PlaceRegion,
    PlaceStage,
    Pose,
    RetreatStage,
    Scene,
    TaskPlan,
    TaskStage,
)

ROBOT = "panda"
HOME = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
#: Names, sizes and centres of the boxes [m].
BOXES = {
    "table": ((0.6, 1.0, 0.04), (0.6, 0.0, 0.08)),
    "wall": ((0.4, 0.03, 0.15), (0.6, 0.0, 0.175)),
    "crate": ((0.05, 0.05, 0.1), (0.5, -0.25, 0.15)),
}
WHOLE_TURN = [0.0, 2.0 * np.pi]
#: Pixels of a metre in the picture, and the colours of the stages in turn.
SCALE = 600.0
COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e")
SAMPLES = 40


def scene() -> Scene:
    """The table, the wall and the crate."""
    return Scene(
        obstacles=[
            Obstacle(id=name, shape=Box(size=size), pose=Pose.at(*center))
            for name, (size, center) in BOXES.items()
        ]
    )


def plan(client: Client) -> TaskPlan:
    """Ask for the whole task."""
    stages: list[TaskStage] = [
        OpenStage(),
        MoveStage(),
        ApproachStage(distance=[0.05, 0.1]),
        GraspStage(
            object="crate",
            region=GraspRegion(
                pose=Pose.from_rpy([0.0, 0.0, 0.02], np.pi, 0.0, 0.0), angles=WHOLE_TURN
            ),
            touch_links=["panda_hand"],
            support="table",
        ),
        CloseStage(),
        AttachStage(object="crate", mass=0.4),
        LiftStage(distance=[0.05, 0.15]),
        MoveStage(),
        ApproachStage(distance=[0.05, 0.1], direction=[0.0, 0.0, -1.0], frame="root"),
        PlaceStage(
            region=PlaceRegion(pose=Pose.at(0.5, 0.25, 0.15), size=[0.1, 0.1], angles=WHOLE_TURN),
            support="table",
        ),
        OpenStage(),
        DetachStage(),
        RetreatStage(distance=[0.05, 0.1]),
        MoveStage(goal=Goal.at_joints(HOME)),
    ]
    return client.plan_task(ROBOT, HOME, stages, scene=scene(), timeout=20.0)


def tell(answer: TaskPlan) -> None:
    """Print what came of each stage."""
    for stage in answer.stages:
        choice = "" if stage.choice is None else f", number {stage.choice}"
        held = ", ".join(item.id for item in stage.after.attached) or "nothing"
        print(f"{stage.kind}{choice}: {stage.trajectory.duration:.2f} s, holds {held}, "
              f"verified {stage.certificate.verified}")  # fmt: skip
    tried = sum(trial.outcome != "open" for trial in answer.trials)
    print(f"{answer.duration:.2f} s in all; {tried} of {len(answer.trials)} alternatives decided")


def draw(client: Client, answer: TaskPlan, path: Path) -> None:
    """Draw the scene from the front, y to the right and z up, with the tool's path."""

    def point(y: float, z: float) -> str:
        return f"{SCALE * (y + 0.6):.1f},{SCALE * (0.8 - z):.1f}"

    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {1.2 * SCALE} {0.8 * SCALE}">']
    for name, ((_, wide, high), (_, y, z)) in BOXES.items():
        corners = [(y - wide / 2, z - high / 2), (y + wide / 2, z - high / 2),
                   (y + wide / 2, z + high / 2), (y - wide / 2, z + high / 2)]  # fmt: skip
        shape = " ".join(point(*corner) for corner in corners)
        parts.append(f'<polygon points="{shape}" fill="#cccccc"><title>{name}</title></polygon>')
    moving = [stage for stage in answer.stages if stage.path is not None]
    for number, stage in enumerate(moving):
        times = np.linspace(0.0, stage.trajectory.duration, SAMPLES)
        poses = client.robots.fk_batch(ROBOT, stage.trajectory.sample(times)).pose
        way = " ".join(point(pose.position[1], pose.position[2]) for pose in poses)
        colour = COLOURS[number % len(COLOURS)]
        parts.append(f'<polyline points="{way}" fill="none" stroke="{colour}" stroke-width="3">'
                     f"<title>{stage.index} {stage.kind}</title></polyline>")  # fmt: skip
    path.write_text("\n".join([*parts, "</svg>", ""]), "utf-8")


def main() -> None:
    """Plan the task, print it and draw it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--url", default="http://127.0.0.1:8000", help="of the service")
    parser.add_argument("--picture", type=Path, help="file to draw into")
    given = parser.parse_args()
    with Client(given.url, timeout=60.0) as client:
        answer = plan(client)
        tell(answer)
        if given.picture is not None:
            draw(client, answer, given.picture)
        assert all(stage.certificate.verified for stage in answer.stages)


if __name__ == "__main__":
    main()
