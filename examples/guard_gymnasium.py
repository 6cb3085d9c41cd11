"""Guard an environment of Gymnasium: an agent learns with an arm that runs proved motions only.

    pip install gymnasium && python -P examples/guard_gymnasium.py [--steps 500] [--seed 0]

Needs no server; -P keeps files of this folder from being taken for Armwright's packages. An action
is a share of each joint's velocity limit, held for a tenth of a second. The gate proves it with the
stop behind it; where it proves nothing the arm goes on with the stop that it has. Exits 0 when a
random agent had a proved stop at every step, and wherever the arm was it touched nothing and kept
its margin.
"""

import argparse
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box

import armwright as aw

START = np.array([0.0, -0.5, 0.0, -2.2, 0.0, 1.7, 0.8])
#: Duration of an action, and share of the velocity limits that it may ask for at most [s, -].
PERIOD, SHARE = 0.1, 0.5
#: Distance of the tool from its aim that ends an episode [m].
REACHED = 0.05
#: Steps after which an episode ends anyway.
STEPS = 200


class GuardedReach(gymnasium.Env[np.ndarray, np.ndarray]):
    """A Panda among obstacles that is to bring its tool to a place, guarded at every step.

    Observed are the joints' positions and velocities and the place, actions are velocities in
    shares of what is allowed, and the reward is the distance to the place, negative [m].
    """

    def __init__(self, margin: float = 0.01) -> None:
        self._robot = aw.load_robot("panda")
        wall = aw.Obstacle("wall", aw.Box((0.1, 2.0, 2.0)), aw.pose([0.75, 0.0, 0.6]))
        post = aw.Obstacle("post", aw.Box((0.1, 0.1, 1.0)), aw.pose([0.4, 0.4, 0.5]))
        self._scene, self._margin = aw.Scene([wall, post]), margin
        limits = self._robot.chain.limits
        self._speed = SHARE * limits.velocity
        low = np.concatenate([limits.lower - 1e-6, -1.1 * limits.velocity, [0.2, -0.5, 0.2]])
        high = np.concatenate([limits.upper + 1e-6, 1.1 * limits.velocity, [0.6, 0.5, 0.8]])
        self.observation_space = Box(low, high, dtype=np.float64)
        self.action_space = Box(-1.0, 1.0, START.shape, dtype=np.float64)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode at rest, with another place."""
        super().reset(seed=seed, options=options)
        self._guard = aw.Guard(self._robot, self._scene, "path", margin=self._margin)
        self._elapsed: float | None = None
        self._place = self.np_random.uniform([0.2, -0.5, 0.2], [0.6, 0.5, 0.8])
        self._steps = 0
        return self._observed(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Have an action proved, and run what was accepted, or the stop that the arm has."""
        wanted = aw.VelocityProposal(np.clip(action, -1.0, 1.0) * self._speed, PERIOD)
        state = aw.JointState(self._states()[0])
        verdict = self._guard.propose(state, wanted, elapsed=self._elapsed)
        accepted = verdict.accepted_until > 0.0
        if self._guard.running is not None:
            self._elapsed = PERIOD + (0.0 if accepted or self._elapsed is None else self._elapsed)
        self._steps += 1
        tool = aw.fk(self._robot, self._states()[0])[:3, 3]
        distance = float(np.linalg.norm(tool - self._place))
        told = {
            "accepted": accepted,
            "proved": verdict.stop.certificate.verified and verdict.stop.stops.proved,
            "violations": [fault.kind for fault in verdict.violations],
        }
        return self._observed(), -distance, distance < REACHED, self._steps >= STEPS, told

    def clearance(self) -> float:
        """Distance to what is around the arm beyond its margin, or of links to links [m]."""
        checker = aw.Checker.of(self._robot, self._scene, self._margin)
        return float(checker.closest(self._states()[:1], 1.0)[0])

    def _states(self) -> np.ndarray:
        """Positions and velocities now, shape (2, n)."""
        running = self._guard.running
        if running is None or self._elapsed is None:
            return np.stack([START, np.zeros_like(START)])
        time = min(self._elapsed, running.motion.duration)
        return np.stack([running.motion.sample([time], order)[0] for order in range(2)])

    def _observed(self) -> np.ndarray:
        return np.concatenate([self._states().ravel(), self._place])


def run(steps: int, seed: int) -> bool:
    """Have a random agent act; whether the arm was safe at every step."""
    arm = GuardedReach()
    arm.reset(seed=seed)
    arm.action_space.seed(seed)
    safe, refused, nearest = True, 0, np.inf
    for _ in range(steps):
        _, _, terminated, truncated, told = arm.step(arm.action_space.sample())
        safe, refused = safe and told["proved"], refused + (not told["accepted"])
        nearest = min(nearest, arm.clearance())
        if terminated or truncated:
            arm.reset()
    print(f"{steps} actions, {refused} refused")
    print(f"a proved stop at every step: {safe}; nearest: {1e3 * nearest:.3g} mm")
    return safe and nearest > 0.0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--steps", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    raise SystemExit(0 if run(given.steps, given.seed) else 1)
