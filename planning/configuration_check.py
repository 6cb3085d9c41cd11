"""Collision and limit check of configurations, with depths and the pairs that collide."""

from dataclasses import dataclass, replace

import numpy as np

from kinematics.arrays import Array
from kinematics.caches.bounded_cache import bounded_cache
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld, OverlapMeter, overlap_meter
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.planner import TOUCHING
from planning.preflight.limits import LimitViolation

#: Distances above this are exact as the kernel finds them; below it FCL measures the depth [m].
_DEPTH_BELOW = 1e-6


@dataclass(frozen=True, slots=True)
class Collision:
    """Two solids that overlap.

    Args:
        pair: Links or obstacles.
        depth: How far they must be moved to be apart [m]; NaN where that was not measured.
    """

    pair: tuple[str, str]
    depth: float


@dataclass(frozen=True, slots=True)
class ConfigurationReport:
    """Verdict on one configuration.

    Args:
        valid: Free of collision, margins kept, inside the position limits.
        clearance: Distance of the closest pair, negative by the depth of the deepest collision,
            margins not taken off [m]; infinite where nothing can collide, NaN where that was
            not measured.
        clearance_pair: That pair; None where nothing can collide.
        collisions: All pairs that collide, the deepest first.
        limit_violations: Joints outside their limits.
    """

    valid: bool
    clearance: float
    clearance_pair: tuple[str, str] | None
    collisions: tuple[Collision, ...]
    limit_violations: tuple[LimitViolation, ...]


@dataclass(frozen=True, slots=True, eq=False)
class ConfigurationChecker:
    """Checks configurations of one robot in one scene.

    Args:
        robot: The robot with what it holds.
        bare: Checker that ignores margins.
        strict: Checker that keeps the obstacles' margins and that of the request.
        plain: The scene without margins, for FCL's depths.
        meter: Of the pairs that may touch.
    """

    robot: RobotGeometry
    bare: Checker
    strict: Checker
    plain: Scene
    meter: OverlapMeter

    @classmethod
    def of(cls, robot: RobotGeometry, scene: Scene, margin: float = 0.0) -> "ConfigurationChecker":
        """Checker of a robot that keeps ``margin`` [m] more than theirs from obstacles."""
        plain = replace(
            scene, obstacles=tuple(replace(obstacle, margin=0.0) for obstacle in scene.obstacles)
        )
        bare = Checker.of(robot, plain)
        margins = margin > 0.0 or any(obstacle.margin > 0.0 for obstacle in scene.obstacles)
        strict = Checker.of(robot, scene, margin) if margins else bare
        return cls(robot, bare, strict, plain, overlap_meter(robot, plain))

    def check(self, q: Array) -> ConfigurationReport:
        """Check a configuration (n,) [rad or m]."""
        clearance, pair = self.bare.clearance(q)
        collisions: tuple[Collision, ...] = ()
        if clearance <= _DEPTH_BELOW:
            world = _fcl_world(self.robot, self.plain)
            contacts = world.collisions(q)
            collisions = tuple(Collision(contact.pair, contact.depth) for contact in contacts)
            if collisions:
                clearance, pair = -collisions[0].depth, collisions[0].pair
            else:
                # Where the two differ, what is nearer counts.
                nearest = world.clearance(q)
                if nearest.distance < clearance:
                    clearance, pair = nearest.distance, nearest.pair
                if clearance <= 0.0 and pair is not None:
                    collisions = (Collision(pair, 0.0),)
        deep = self.meter.too_deep(q)
        if deep:
            found = (*collisions, *(Collision(item.pair, depth) for item, depth in deep))
            collisions = tuple(sorted(found, key=lambda item: -item.depth))
            clearance, pair = -collisions[0].depth, collisions[0].pair
        strict = clearance if self.strict is self.bare else self.strict.clearance(q)[0]
        violations = self._limit_violations(q)
        valid = not collisions and not violations and strict > TOUCHING
        return ConfigurationReport(valid, clearance, pair, collisions, violations)

    def verdict(self, q: Array) -> ConfigurationReport:
        """Check a configuration (n,) [rad or m], no depth and no clearance measured.

        One pair that collides is told where there is any.
        """
        violations = self._limit_violations(q)
        deep = self.meter.too_deep(q)
        valid = self.strict.valid(q) and not violations and not deep
        collisions: tuple[Collision, ...] = tuple(Collision(i.pair, np.nan) for i, _ in deep[:1])
        if not valid and not deep and not self.bare.valid(q):
            clearance, pair = self.bare.clearance(q)
            if pair is not None and clearance <= _DEPTH_BELOW:
                collisions = (Collision(pair, np.nan),)
        return ConfigurationReport(valid, np.nan, None, collisions, violations)

    def _limit_violations(self, q: Array) -> tuple[LimitViolation, ...]:
        chain, limits = self.robot.chain, self.robot.chain.limits
        inside = np.clip(q, limits.lower, limits.upper)
        return tuple(
            LimitViolation(chain.joint_names[j], float(q[j]), float(inside[j]))
            for j in np.flatnonzero(inside != q).tolist()
        )


@bounded_cache(maxsize=8)
def _fcl_world(robot: RobotGeometry, scene: Scene) -> FclWorld:
    """FCL's depths, made when the first configuration collides."""
    return FclWorld(robot, scene)


@bounded_cache(maxsize=8)
def configuration_checker(
    robot: RobotGeometry, scene: Scene, margin: float = 0.0
) -> ConfigurationChecker:
    """Checker of a robot in a scene; the last few are kept."""
    return ConfigurationChecker.of(robot, scene, margin)
