"""Closed loops: seconds for five of a Panda under each controller, continuous and held for 1 ms.

Run it with `python -m benchmarks.tracking`. The robot is a fifth heavier than the controllers
believe, and its encoders are noisy where the torque is held.
"""

import time

import numpy as np

from dynamics.body import scale_masses
from kinematics.interpolation import interpolate
from kinematics.robots import builtin_chain
from tracking.adaptive import Adaptive
from tracking.computed_torque import ComputedTorque
from tracking.disturbance import EncoderNoise
from tracking.independent_joint import IndependentJoint, effective_inertia
from tracking.passivity import Passivity
from tracking.pd_gravity import PdGravity
from tracking.simulation import SimulationOptions, simulate

HOME = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8])
FREQUENCY, SECONDS, ROUNDS = 15.0, 5.0, 5


def main() -> None:
    """Simulate and print."""
    chain = builtin_chain("panda")
    felt = effective_inertia(chain, HOME)
    t = np.linspace(0.0, SECONDS, 51)
    q = HOME + 0.4 * (1.0 - np.cos(np.outer(t, np.linspace(1.0, 2.0, 7))))
    motion = interpolate(chain.joint_names, t, q, "clamped_spline")
    loops = {
        "independent joint": IndependentJoint.by_pole_placement(chain, FREQUENCY, 1.0, felt),
        "computed torque": ComputedTorque.by_pole_placement(chain, FREQUENCY),
        "PD + gravity": PdGravity(chain, felt * FREQUENCY**2, 2.0 * felt * FREQUENCY),
        "passivity": Passivity(chain, np.array(FREQUENCY), felt * FREQUENCY),
        "adaptive": Adaptive(chain, np.array(FREQUENCY), felt * FREQUENCY, np.array(0.3)),
    }
    print("5 s of a Panda      continuous: s, steps (implicit)     held 1 ms: s, steps")
    for name, controller in loops.items():
        line = f"{name:18}"
        for period in (None, 1e-3):
            options = SimulationOptions(control_period=period)
            noise = None if period is None else EncoderNoise(1e-5, 1e-3)
            best = np.inf
            for _ in range(ROUNDS):
                start = time.perf_counter()
                result = simulate(
                    controller, motion, options, robot=scale_masses(chain, 1.2), noise=noise
                )
                best = min(best, time.perf_counter() - start)
            steps = f"{result.steps + result.implicit_steps} ({result.implicit_steps})"
            line += f"{best:12.3f} {steps:>14} {result.outcome.name.lower()}"
        print(line)


if __name__ == "__main__":
    main()
