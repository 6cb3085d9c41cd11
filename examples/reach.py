"""Find where an arm reaches, and where it should stand to serve six places on a table.

    armwright serve &
    python examples/reach.py [--url http://127.0.0.1:8000] [--picture reach.svg]

Draws the reach of a UR5e above a table with a post, then tries places for its base beside the
table. Exits 0 when a base was found from which all places are reached.
"""

import argparse
from pathlib import Path

import numpy as np

from armwright_client import (
    BaseRegion,
    Box,
    Client,
    Obstacle,
    Pose,
    ReachBox,
    ReachOptions,
    ReachTolerance,
    Scene,
)

ROBOT = "ur5e"
DOWN = [1.0, 0.0, 0.0, 0.0]
SCENE = Scene(
    obstacles=[
        Obstacle(id="table", shape=Box(size=[0.8, 1.6, 0.04]), pose=Pose.at(0.7, 0.0, 0.08)),
        Obstacle(id="post", shape=Box(size=[0.08, 0.08, 0.6]), pose=Pose.at(0.6, 0.0, 0.4)),
    ]
)
PLACES = [
    Pose.from_rpy([x, y, 0.3], np.pi, 0.0, 0.0) for x in (0.45, 0.75) for y in (-0.35, 0.15, 0.35)
]
#: Whichever way the gripper is turned about its own axis.
ANY_SPIN = ReachTolerance(free=["rz"], samples=8)


def draw(client: Client, picture: Path) -> None:
    """The reach with the tool pointing down, in three layers above the table."""
    box = ReachBox(size=[1.6, 1.6, 0.3], pose=Pose.at(0.4, 0.0, 0.4), spacing=0.1,
                   orientations=[DOWN])  # fmt: skip
    options = ReachOptions(scene=SCENE, tolerance=ANY_SPIN, timeout=30.0)
    answer = client.robots.reach(ROBOT, box, **options)
    print(f"{answer.reached} of {answer.count} points are reached from where it stands")
    picture.write_text(client.robots.reach_picture(ROBOT, box, **options), "utf-8")


def place(client: Client) -> bool:
    """Whether some place for the base reaches all places; the best one is printed."""
    region = BaseRegion(x=[-0.2, 0.2], y=[-0.4, 0.4], z=0.0, spacing=0.2, yaws=4)
    answer = client.robots.reach(
        ROBOT, PLACES, scene=SCENE, tolerance=ANY_SPIN, base_region=region, timeout=60.0
    )
    assert answer.bases is not None
    best, last = answer.bases[0], answer.bases[-1]
    x, y, _ = best.pose.position
    print(f"{len(answer.bases)} bases: the best reaches {best.reached} of {answer.count} places, "
          f"the worst {last.reached}")  # fmt: skip
    if best.clearance is not None:
        print(f"best at ({x:.2f}, {y:.2f}), {1e3 * best.clearance:.0f} mm clear at the least")
    return best.reached == answer.count


def main() -> int:
    """Draw and place."""
    parser = argparse.ArgumentParser(description="Reach and base placement of a UR5e.")
    parser.add_argument("--url", default="http://127.0.0.1:8000")
    parser.add_argument("--picture", type=Path, default=Path("reach.svg"))
    chosen = parser.parse_args()
    with Client(chosen.url) as client:
        draw(client, chosen.picture)
        return 0 if place(client) else 1


if __name__ == "__main__":
    raise SystemExit(main())
