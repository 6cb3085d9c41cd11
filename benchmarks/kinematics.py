"""Forward kinematics and Jacobians beside pinocchio in one run, a call from Python and batched.

Run it with `python -m benchmarks.kinematics`. Calls are interleaved in small rounds, so that a busy
machine disturbs all of them alike; medians of the rounds are told. The reference is what a Python
user of pinocchio calls: framesForwardKinematics and computeFrameJacobian of the tip.
"""

import argparse
from collections.abc import Callable

import numpy as np
import pinocchio as pin

from benchmarks.problems.poses import random_configurations
from benchmarks.rounds import once, rounds
from kinematics.forward import forward, link_poses
from kinematics.jacobian import geometric, pose_and_jacobian
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain, builtin_urdf

ROBOTS = ("panda", "ur5e", "iiwa14", "kr6_sixx", "scara")
ROUNDS, CALLS, BATCH = 41, 1000, 100_000


def singles(name: str, chain: Chain) -> None:
    """One configuration a call."""
    model = pin.buildModelFromXML(builtin_urdf(name))
    data = model.createData()
    frame = model.getFrameId(chain.tip_link)
    q = random_configurations(chain, 1, 1)[0]

    def theirs() -> object:
        pin.framesForwardKinematics(model, data, q)
        return pin.computeFrameJacobian(
            model, data, q, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )

    calls: dict[str, Callable[[], object]] = {
        "pinocchio FK + Jacobian": theirs,
        "FK of the tip": lambda: forward(chain, q),
        "Jacobian": lambda: geometric(chain, q),
        "FK + Jacobian": lambda: pose_and_jacobian(chain, q),
        "FK of all links": lambda: link_poses(chain, q),
    }
    spent = rounds(calls, ROUNDS, dict.fromkeys(calls, CALLS))
    medians = {what: np.median(values) for what, values in spent.items()}
    reference = medians["pinocchio FK + Jacobian"]
    for what, value in medians.items():
        print(f"{name:7s} {what:24s} {value:6.3f} us  {value / reference:5.2f} x")


def batches(name: str, chain: Chain) -> None:
    """Many configurations a call, on one core, beside pinocchio's Python loop."""
    model = pin.buildModelFromXML(builtin_urdf(name))
    data = model.createData()
    frame = model.getFrameId(chain.tip_link)
    q = random_configurations(chain, BATCH, 2)

    def theirs() -> None:
        for row in q:
            pin.framesForwardKinematics(model, data, row)
            pin.computeFrameJacobian(
                model, data, row, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            )

    reference = once(theirs, 3) / BATCH
    print(f"{name:7s} batch of {BATCH}: pinocchio's loop {reference:.3f} us a configuration")
    calls: dict[str, Callable[[], object]] = {
        "FK of the tip": lambda: forward(chain, q),
        "Jacobian": lambda: geometric(chain, q),
        "FK of all links": lambda: link_poses(chain, q),
    }
    for what, call in calls.items():
        value = once(call) / BATCH
        print(f"{name:7s} {what:24s} {value:6.3f} us  {reference / value:5.1f} x faster")


def main() -> None:
    """Measure some robots."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("robots", nargs="*", default=ROBOTS)
    for name in parser.parse_args().robots:
        chain = builtin_chain(name)
        singles(name, chain)
        batches(name, chain)


if __name__ == "__main__":
    main()
