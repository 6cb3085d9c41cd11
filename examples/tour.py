"""Visit drilling spots on a panel in the best order, and draw the way of the tool.

    armwright serve &
    python examples/tour.py [--url http://127.0.0.1:8000] [--picture tour.svg]

A KR 6 visits 24 spots in two rows, the upper row first. Exits 0 when all of them are visited.
"""

import argparse
from pathlib import Path

from armwright_client import Box, Client, Obstacle, Pose, Scene, Start, Tour, TourGoal

ROBOT = "kr6_sixx"
START = Start(joints=[0.0, -1.44, 2.5, 0.0, -1.07, 0.0])
#: The tool's z into the panel, its x down.
INTO_PANEL = [0.0, 0.7071067811865476, 0.0, 0.7071067811865476]
SCENE = Scene(
    obstacles=[
        Obstacle(id="panel", shape=Box(size=[0.02, 0.9, 0.7]), pose=Pose.at(0.72, 0.0, 0.5)),
        Obstacle(id="clamp", shape=Box(size=[0.1, 0.3, 0.04]), pose=Pose.at(0.66, 0.0, 0.5)),
    ]
)
#: Pixels a metre, and where the middle of the panel is drawn.
SCALE, MIDDLE = 600.0, (300.0, 400.0)


def spots() -> list[TourGoal]:
    """Spots in two rows, each by any turn of the tool about its axis."""
    return [
        TourGoal(
            id=f"spot_{row}_{k}",
            pose=Pose.at(0.66, 0.06 * k - 0.33 + 0.01 * row, 0.4 + 0.2 * row).model_copy(
                update={"quaternion_xyzw": INTO_PANEL}
            ),
            dwell=0.3,
            group=f"row_{row}",
        )
        for row in range(2)
        for k in range(12)
    ]


def draw(client: Client, tour: Tour, picture: Path) -> None:
    """The way of the tool in front of the panel, y to the left and z upwards."""
    rows = [joints for leg in tour.legs for joints in leg.path.joints]
    poses = client.robots.fk_batch(ROBOT, rows).pose
    points = [(MIDDLE[0] - SCALE * p.position[1], MIDDLE[1] - SCALE * (p.position[2] - 0.4))
              for p in poses]  # fmt: skip
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    dots = [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3"/>' for x, y in points]
    picture.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="600" height="600">\n'
        f"<title>Tour over {len(tour.visits)} spots in {tour.time:.2f} s</title>\n"
        '<rect width="100%" height="100%" fill="#f4f4f4"/>\n'
        f'<polyline points="{line}" fill="none" stroke="#2d146e"/>\n'
        + "\n".join(dots)
        + "\n</svg>",
        "utf-8",
    )


def main() -> int:
    """Plan, print and draw."""
    parser = argparse.ArgumentParser(description="A tour over drilling spots.")
    parser.add_argument("--url", default="http://127.0.0.1:8000")
    parser.add_argument("--picture", type=Path, default=Path("tour.svg"))
    chosen = parser.parse_args()
    with Client(chosen.url) as client:
        tour = client.plan_tour(
            ROBOT, spots(), start=START, end="start", scene=SCENE,
            precedence=[("row_1", "row_0")], rounds=2, timeout=60.0,
        )  # fmt: skip
        print(f"{len(tour.visits)} spots in {tour.time:.2f} s, {tour.dwell_time:.2f} s of it stays")
        print(" ".join(tour.order))
        draw(client, tour, chosen.picture)
    return 0 if not tour.unvisited else 1


if __name__ == "__main__":
    raise SystemExit(main())
