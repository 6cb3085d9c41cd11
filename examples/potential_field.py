"""Plan by a potential field on three arms, with RRT-Connect where the field is stuck.

    armwright serve &
    python examples/potential_field.py [--url http://127.0.0.1:8000]

The descent projects its control points onto the obstacles by FCL, every motion is timed by a cubic
spline. Each arm turns past a low post, which the field passes, and past a pillar, before which
the field stops. Exits 0 when each motion was planned by whom it should be, and proved.
"""

import argparse

from armwright_client import Box, Client, Obstacle, Plan, PlanningFailed, Pose, Scene, Timing

#: Configurations in the middle of the turn, and the places before the tools there.
ARMS = {
    "panda": ([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], [0.337, 0.0, 0.487]),
    "ur5e": ([0.0, -1.2, 1.5, -1.8, -1.57, 0.0], [-0.65, -0.14, 0.336]),
    "iiwa14": ([0.0, 0.6, 0.0, -1.5, 0.0, 1.0, 0.0], [0.618, 0.0, 0.379]),
}
#: From the middle to both ends of the turn, of the first joint [rad].
TURN = 0.7
#: A pull in joint space beside that on the points, and no straight connection to the goal.
FIELD = {"engine": "fcl", "joint_weight": 0.1, "connect": False}


def plan(client: Client, name: str, height: float, below: float, **options: object) -> Plan:
    """A turn past a box of a height, whose middle is below the place of the tool [m]."""
    (first, *others), (x, y, z) = ARMS[name]
    post = Obstacle(id="post", shape=Box(size=[0.08, 0.08, height]), pose=Pose.at(x, y, z - below))
    return client.plan(
        name, [first - TURN, *others], [first + TURN, *others], scene=Scene(obstacles=[post]),
        planner="potential_field", planner_options=FIELD | options,
        timing=Timing(method="spline"), timeout=20.0,
    )  # fmt: skip


def told(plan: Plan) -> str:
    """The planner of a plan, its proof, and the reason why the field gave up."""
    field = next(stage for stage in plan.stages if stage.name == "potential_field")
    proof = "proved" if plan.certificate.verified else "not proved"
    return f"{plan.planner}, {proof}; the field: {(field.detail or '').split('.')[0]}"


def main() -> int:
    """Turn every arm past both boxes."""
    parser = argparse.ArgumentParser(description="Potential fields with a fallback.")
    parser.add_argument("--url", default="http://127.0.0.1:8000")
    with Client(parser.parse_args().url) as client:
        return 0 if turn_all(client) else 1


def turn_all(client: Client) -> bool:
    """Whether the field passes all posts, and only the fallback passes the pillars."""
    right = []
    for name in ARMS:
        post, pillar = plan(client, name, 0.2, 0.3), plan(client, name, 0.5, 0.05)
        print(f"{name}, post: {told(post)}")
        print(f"{name}, pillar: {told(pillar)}")
        right += [post.planner == "potential_field", pillar.planner == "rrt_connect"]
        right += [post.certificate.verified, pillar.certificate.verified]
        try:
            plan(client, name, 0.5, 0.05, fallback=None)
        except PlanningFailed as error:
            print(f"{name}, pillar without a fallback: {error.details['ending']}")
    return all(right)


if __name__ == "__main__":
    raise SystemExit(main())
