"""Guard a random policy: nothing that it proposes is run before it is proved with its stop.

    python -P examples/guard_policy.py [--steps 10000] [--seed 0]

Needs no server; -P keeps files of this folder from being taken for Armwright's packages. A policy
that knows nothing of the scene proposes eight joint targets at 30 Hz; the arm runs what the gate
accepts, and stops where it accepts nothing in time. Exits 0 when the arm had a proved stop at every
step, and wherever it was measured touched nothing and kept its margin.
"""

import argparse
from collections import Counter

import numpy as np

import armwright as aw

ROBOT = aw.load_robot("panda")
SCENE = aw.Scene(
    [
        aw.Obstacle("table", aw.Box((1.2, 1.2, 0.1)), aw.pose([0.5, 0.0, -0.1])),
        aw.Obstacle("post", aw.Box((0.1, 0.1, 1.0)), aw.pose([0.5, 0.3, 0.5])),
        aw.Obstacle("lamp", aw.Sphere(0.12), aw.pose([0.4, -0.4, 0.7])),
    ]
)
START = np.array([0.0, -0.5, 0.0, -2.2, 0.0, 1.7, 0.8])
#: Distance to keep from obstacles [m].
MARGIN = 0.01
#: The policy's period, its latency, and when it proposes anew [s].
PERIOD, LATENCY, EVERY = 1.0 / 30.0, 0.02, 0.1


def policy(random: np.random.Generator, state: np.ndarray, aim: np.ndarray) -> np.ndarray:
    """Eight targets towards an aim, each a little off."""
    q, v = state
    times = PERIOD * np.arange(1, 9)[:, None]
    speed = v + np.clip(aim - q - v, -1.0, 1.0) * random.uniform(0.0, 1.2)
    towards = q + v * times + 0.5 * (speed - v) * times**2 / times[-1]
    targets: np.ndarray = towards + random.normal(0.0, 2e-4, towards.shape)
    return targets


def run(steps: int, seed: int) -> bool:
    """Guard so many proposals; whether the arm was safe at every one."""
    random, guard = np.random.default_rng(seed), aw.Guard(ROBOT, SCENE, "path", margin=MARGIN)
    limits, checker = ROBOT.chain.limits, aw.Checker.of(ROBOT, SCENE, MARGIN)
    told: Counter[str] = Counter()
    elapsed, aim, safe, nearest = None, START, True, np.inf
    for step in range(steps):
        if step % 20 == 0:
            aim = random.uniform(limits.lower, limits.upper)
        if guard.running is None or elapsed is None:
            state, ahead = aw.JointState(START), np.stack([START, 0.0 * START])
        else:
            motion = guard.running.motion
            now, then = (min(elapsed + wait, motion.duration) for wait in (0.0, LATENCY))
            measured = motion.sample([now])[0] + random.normal(0.0, 1e-4, len(START))
            state = aw.JointState(measured)
            ahead = np.stack([motion.sample([then], order)[0] for order in range(2)])
            nearest = min(nearest, checker.closest(motion.sample([now]), 1.0)[0])
        targets = aw.SamplesProposal(policy(random, ahead, aim), PERIOD, "natural_spline")
        verdict = guard.propose(state, targets, LATENCY, elapsed=elapsed)
        safe = safe and verdict.stop.certificate.verified and verdict.stop.stops.proved
        accepted = verdict.accepted_until > 0.0
        told["run as proposed" if accepted and not verdict.violations else
             "slowed down or cut" if accepted else "refused"] += 1  # fmt: skip
        told.update(f"  for {kind}" for kind in {fault.kind for fault in verdict.violations})
        # The arm has begun with what was accepted, or goes on with what it has.
        elapsed = EVERY - LATENCY if accepted else EVERY if elapsed is None else elapsed + EVERY
        elapsed = elapsed if guard.running is not None else None
    print(f"{steps} proposals, {steps * EVERY:.0f} s of motion")
    for name, count in told.items():
        print(f"{name}: {count}")
    print(f"a proved stop at every step: {safe}; nearest: {1e3 * nearest:.3g} mm")
    return safe and nearest > 0.0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--steps", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    raise SystemExit(0 if run(given.steps, given.seed) else 1)
