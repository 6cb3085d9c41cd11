"""Follow a seam on a pipe with a torch that may turn about its own axis and tilt a little.

    python examples/seam.py [URL]

The seam's points and normals are all that is asked for; the service chooses the branch of the arm
and the turns of the torch, and proves deviation, speed and clearance for every instant.
"""

import math
import sys

from armwright_client import (
    CartesianOptions,
    Client,
    Goal,
    Plan,
    Pose,
    StraightOffset,
    ToolTolerance,
    Waypoint,
)

START = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
#: Radius of the pipe, which lies along x, and height of its axis [m].
RADIUS, HEIGHT = 0.15, 0.2


def seam() -> list[Waypoint]:
    """Waypoints round the upper side of the pipe."""
    waypoints = []
    for k in range(40):
        angle = -0.7 + 1.4 * k / 39
        normal = [0.0, math.sin(angle), math.cos(angle)]
        point = [0.5 + 0.02 * angle, RADIUS * normal[1], HEIGHT + RADIUS * normal[2]]
        waypoints.append(Waypoint.on(point, normal))
    return waypoints


def follow(client: Client) -> Plan:
    """Plan the seam and say how well it is kept."""
    waypoints = seam()
    options = CartesianOptions(
        waypoints=waypoints,
        tolerance=ToolTolerance(tilt=0.1),
        tool_speed=0.05,
        approach=StraightOffset(direction=[0.0, 0.0, 1.0], distance=0.05),
        retreat=StraightOffset(direction=[0.0, 0.0, -1.0], distance=0.05),
    )
    end = waypoints[-1].point
    assert end is not None
    answer = client.plan(
        "panda", START, Goal.at_pose(Pose.at(*end)), planner="cartesian",
        planner_options=options.as_options(),
    )  # fmt: skip
    certificate = answer.certificate
    assert certificate.tool_speed is not None
    assert certificate.tool_tolerance is not None
    print(f"verified: {certificate.verified}")
    print(f"share of the seam at its speed: {certificate.tool_speed.share:.2f}")
    print(f"largest share of the tolerance: {certificate.tool_tolerance.share:.2f}")
    return answer


def main() -> None:
    """Follow the seam by the service of the command line."""
    with Client(sys.argv[1] if len(sys.argv) > 1 else "http://localhost:8000") as client:
        follow(client)


if __name__ == "__main__":
    main()
