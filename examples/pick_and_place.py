"""Pick a crate from a table and put it behind a wall, in three plans over HTTP.

    armwright serve &
    python examples/pick_and_place.py [--url http://127.0.0.1:8000]

The crate is an obstacle while it stands, a part of the robot while it
is held, and an obstacle again where it was put. Every motion is proved for every instant. Exits 0
when everything was as it should be.
"""

import argparse

import numpy as np

from armwright_client import (
    Attached,
    Box,
    CartesianOptions,
    Client,
    Goal,
    Obstacle,
    Plan,
    Pose,
    Scene,
    StartStateInCollision,
    Timing,
    ToolMotion,
)

ROBOT, HAND = "panda", "panda_hand"
HOME = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
#: The crate is 10 cm high and stands on the table, whose top is at 0.1 m.
CRATE, TABLE_TOP = (0.05, 0.05, 0.1), 0.1
PICK, PLACE = (0.50, -0.25), (0.50, 0.25)
#: The tool's point is held 3 cm below the crate's top, pointing down.
GRIP = TABLE_TOP + 0.07
#: Over the wall between the two places, which is 15 cm high.
OVER = TABLE_TOP + 0.33


def box(name: str, size: tuple[float, ...], x: float, y: float, z: float) -> Obstacle:
    """A box by its size and centre."""
    return Obstacle(id=name, shape=Box(size=size), pose=Pose.at(x, y, z))


def scene(at: tuple[float, float]) -> Scene:
    """The table, the wall and the crate, standing at a place."""
    return Scene(
        obstacles=[
            box("table", (0.6, 1.0, 0.04), 0.6, 0.0, TABLE_TOP - 0.02),
            box("wall", (0.4, 0.03, 0.15), 0.6, 0.0, TABLE_TOP + 0.075),
            box("crate", CRATE, *at, TABLE_TOP + 0.05),
        ]
    )


def down(x: float, y: float, z: float) -> Pose:
    """The tool pointing straight down."""
    return Pose.from_rpy([x, y, z], np.pi, 0.0, 0.0)


def tell(title: str, plan: Plan) -> None:
    """Print what came of a plan."""
    certificate = plan.certificate
    clearance = 1e3 * (certificate.min_clearance or 0.0)
    print(f"{title}: {plan.planner}, {plan.trajectory.duration:.2f} s")
    print(f"  verified {certificate.verified}, at least {clearance:.2f} mm clear, "
          f"{' and '.join(certificate.clearance_pair or ())}")  # fmt: skip
    if certificate.path_deviation is not None:
        off = 1e6 * certificate.path_deviation.position
        print(f"  tool within {off:.1f} um of its lines at every instant")


def end(plan: Plan) -> list[float]:
    """Where the arm stands after a plan."""
    return list(plan.path.joints[-1])


def main() -> None:
    """Run the three plans."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--url", default="http://127.0.0.1:8000", help="of the service")
    with Client(parser.parse_args().url, timeout=60.0) as client:
        timing = Timing(velocity_scaling=0.5, acceleration_scaling=0.5, torque_limits=True)
        grip = [("panda_hand", "crate")]
        # 1. To the crate. The hand may touch it.
        reach = client.plan(
            ROBOT, HOME, Goal.at_pose(down(*PICK, GRIP)), scene=scene(PICK), timing=timing,
            allowed_collisions=grip, seed=1,
        )  # fmt: skip
        tell("reach", reach)
        # 2. Up, across and down with it: it was taken where it stands, and may touch the table.
        crate = Attached(
            id="crate", link=HAND, grasp_joints=end(reach), touch_links=["table"], mass=0.4
        )
        way = [down(*PICK, OVER), down(*PLACE, OVER), down(*PLACE, GRIP)]
        options = CartesianOptions(motions=[ToolMotion.lin(pose) for pose in way])
        carry = client.plan(
            ROBOT, end(reach), Goal.at_pose(way[-1]), scene=scene(PICK), attached=[crate],
            planner="cartesian", planner_options=options.as_options(), timing=timing,
        )  # fmt: skip
        tell("carry", carry)
        # 3. Away from it: it is an obstacle again, where it was put.
        leave = client.plan(
            ROBOT, end(carry), Goal.at_pose(down(*PLACE, OVER)), scene=scene(PLACE),
            allowed_collisions=grip, planner="cartesian", timing=timing,
        )  # fmt: skip
        tell("leave", leave)
        # A crate that rests on the table touches it: where that is not allowed, it is told.
        try:
            shy = crate.model_copy(update={"touch_links": []})
            client.plan(ROBOT, end(reach), HOME, scene=scene(PICK), attached=[shy])
        except StartStateInCollision as error:
            print(f"not allowed to touch the table: {error}")
            print(f"  pair {error.pair}, depth {error.depth} m, free at {error.nearest_valid}")
        assert all(plan.certificate.verified for plan in (reach, carry, leave))


if __name__ == "__main__":
    main()
