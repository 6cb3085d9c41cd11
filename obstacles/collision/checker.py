"""Exact verdicts about configurations and joint motions: free, colliding, how far apart."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import direct
from kinematics.arrays import Array, Indices
from kinematics.model.chain import Chain, Limits, Link
from obstacles.collision.edge_check import COLLIDING, FREE, certify_curve
from obstacles.collision.lanes.check import mark_blocked
from obstacles.collision.line_check import certify_edge, certify_path, check_straight, round_corners
from obstacles.collision.model.collision_model import CollisionModel, ModelArrays
from obstacles.collision.model.kernel_work import workspace
from obstacles.collision.proximity import closest_pair, closest_state, near_pairs
from obstacles.collision.state_check import verdict_in, verdict_on
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene

_F = TypeVar("_F", bound=Callable[..., object])
_FLOAT = np.dtype(np.float64)
#: Parts of a motion at whose ends ``straight`` checks states.
_CHECKED = 16
#: States of which the depth of a collision is measured, at most.
_MOST_OVERLAPS = 60
#: Near pairs that buffers hold at first.
_NEAR_PAIRS = 64


@cache
def _direct(kernel: _F) -> _F:
    """A kernel without the check of its arguments' types, which would cost more than some do."""
    row, rows = np.zeros(1), np.zeros((1, 1))
    examples: dict[object, tuple[object, ...]] = {
        certify_edge: (row, row, 0.0),
        verdict_on: (row, 0.0),
        certify_curve: (row, row, row, row, 0.0, row),
        check_straight: (row, row, 0.0, 1, row),
        mark_blocked: (rows, 0.0, row, False),
        closest_pair: (row,),
        closest_state: (rows, 0.0),
        round_corners: (rows, 0.0, 1, True, True, 0, row),
    }
    return direct(kernel, any_model(), *examples[kernel])


def any_model() -> ModelArrays:
    """A model that stands for all of them where a kernel is looked up by its arguments' types."""
    limits = Limits.unlimited(1)
    links = (Link("base", -1, np.eye(4)), Link("tip", 0, np.eye(4)))
    turning = np.zeros(1, dtype=np.int64), np.eye(4)[None]
    chain = Chain("any", ("j",), *turning, links, "base", "tip", limits, np.zeros(1, np.bool_))
    return CollisionModel.bare(chain).arrays


@dataclass(frozen=True, slots=True)
class Motion:
    """Verdict on a joint motion.

    Args:
        free: Proved free for every instant.
        colliding: A configuration on it was found that collides; neither is set where a pair comes
            within a millionth of a metre of its margin.
        at: Place along the motion at which it was stopped, from 0 to 1; 1 where it is free.
        pair: The link and what it met; None where the motion is free.
        clearance: A lower bound of the clearance over the whole motion, margins taken off [m];
            -inf where none is computed.
        intervals: Intervals that were checked; parts of meshes count as intervals too.
    """

    free: bool
    colliding: bool
    at: float
    pair: tuple[str, str] | None
    clearance: float
    intervals: int


class Proximity(NamedTuple):
    """Pairs that are near each other in one configuration, and how their distances change.

    Args:
        pairs: Numbers for ``CollisionModel.pair_name``, shape (m,).
        distances: Signed distances, margins taken off, negative by the depth of overlap, (m,) [m].
        gradients: Gradients of the distances with respect to the joints, shape (m, n) [m/rad or 1].
    """

    pairs: Indices
    distances: Array
    gradients: Array


class Bracket(NamedTuple):
    """Verdict of bounding and inscribed spheres on a configuration.

    Args:
        free: All outer spheres are clear.
        colliding: An inner sphere met something.
        flagged: Pairs that neither decides, for the exact test; where it collides, those found
            before.
    """

    free: bool
    colliding: bool
    flagged: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True, eq=False)
class Checker:
    """Answers for one robot in one scene.

    Args:
        model: The packed robot and scene, with the margin of every pair.
        slack: Distance to keep beyond that from everything, in self-collision pairs too [m].
    """

    model: CollisionModel
    slack: float = 0.0

    @classmethod
    def of(cls, robot: RobotGeometry, scene: Scene, margin: float = 0.0) -> Self:
        """The checker of a robot in a scene, ``margin`` [m] to be kept from its obstacles."""
        return cls(CollisionModel(robot, scene, margin))

    def clearance(self, q: Array) -> tuple[float, tuple[str, str] | None]:
        """Distance of the closest pair, margins taken off [m], and the pair.

        Exact where positive; 0 or below says that something touches, not how deep. Infinite, and no
        pair, where nothing can collide.
        """
        distance, pair = _direct(closest_pair)(self.model.arrays, np.ascontiguousarray(q, _FLOAT))
        return distance - self.slack, None if pair < 0 else self.model.pair_name(pair)

    def closest(self, states: Array, within: float) -> tuple[float, int, tuple[str, str] | None]:
        """The least ``clearance`` of states (k, n), if it is below ``within`` [m].

        Returns:
            The distance, ``within`` where nothing is closer [m], the number of the state, and the
            pair; -1 and None where nothing is.
        """
        points = np.ascontiguousarray(states, _FLOAT)
        beyond = float(within + self.slack)
        found, state, pair = _direct(closest_state)(self.model.arrays, points, beyond)
        return found - self.slack, state, None if pair < 0 else self.model.pair_name(pair)

    def gradient(self, q: Array, within: float) -> Proximity:
        """Signed distances of all pairs closer than ``within`` [m], and their gradients.

        A distance has no gradient where the direction it is measured along jumps (the middle of a
        solid, the edge of a face opposite to another face); one of those on either side is
        answered there. Pairs of pieces count, so a link that is made of several, or a mesh, can
        occur several times with one obstacle.

        Args:
            q: Shape (n,).
            within: Pairs farther apart than this, margins taken off, are left out [m].
        """
        point = np.ascontiguousarray(q, dtype=np.float64)
        m, buffer = _NEAR_PAIRS, 0
        while m > buffer:
            buffer = m
            pairs, distances = np.empty(buffer, np.int64), np.empty(buffer)
            gradients = np.empty((buffer, len(point)))
            m = near_pairs(
                self.model.arrays, point, within + self.slack, pairs, distances, gradients
            )
        return Proximity(pairs[:m], distances[:m] - self.slack, gradients[:m])

    def least_overlap(self, states: Array) -> tuple[float, tuple[str, str]] | None:
        """The depth [m] and the pair of the least deep of some collisions, of states (k, n).

        Of more than sixty states some are measured, spread over all. None where none collides.
        """
        best: tuple[float, tuple[str, str]] | None = None
        for q in states[:: max(1, len(states) // _MOST_OVERLAPS)]:
            near = self.gradient(q, 0.0)
            if not near.distances.size:
                continue
            depth, pair = -float(near.distances.min()), int(near.pairs[near.distances.argmin()])
            if best is None or depth < best[0]:
                best = depth, self.model.pair_name(pair)
        return best

    def valid(self, q: Array) -> bool:
        """Whether a configuration keeps every pair its margin apart."""
        point = np.ascontiguousarray(q, _FLOAT)
        return bool(_direct(verdict_on)(self.model.arrays, point, float(self.slack)) == FREE)

    def all_valid(self, states: Array) -> bool:
        """Whether all of the configurations (k, n) are ``valid``."""
        points = np.ascontiguousarray(states, _FLOAT)
        blocked = np.empty(len(points))
        return not _direct(mark_blocked)(
            self.model.arrays, points, float(self.slack), blocked, True
        )

    def each_valid(self, states: Array) -> NDArray[np.bool_]:
        """Verdicts ``valid`` of configurations (k, n), shape (k,)."""
        points = np.ascontiguousarray(states, _FLOAT)
        blocked = np.empty(len(points))
        _direct(mark_blocked)(self.model.arrays, points, float(self.slack), blocked, False)
        return np.asarray(blocked == 0.0)

    def bracket(self, q: Array) -> "Bracket":
        """Verdict of the spheres alone, with the pairs that they leave to the exact test."""
        point = np.ascontiguousarray(q, dtype=np.float64)
        asked = np.zeros(1 + _NEAR_PAIRS, dtype=np.int64)
        arrays, slack = self.model.arrays, float(self.slack)
        verdict = verdict_in(arrays, workspace(arrays), point, slack, asked)
        if asked[0] >= len(asked):
            asked = np.zeros(1 + asked[0], dtype=np.int64)
            verdict = verdict_in(arrays, workspace(arrays), point, slack, asked)
        pairs = tuple(self.model.pair_name(int(pair)) for pair in asked[1 : 1 + asked[0]])
        return Bracket(verdict == FREE, verdict == COLLIDING, pairs)

    def segment(self, start: Array, end: Array) -> Motion:
        """Prove the straight joint motion from ``start`` to ``end``, both (n,)."""
        return self.curve(start, end - start, np.zeros_like(start))

    def curve(self, b0: Array, b1: Array, b2: Array, b3: Array | None = None) -> Motion:
        """Prove the joint motion b0 + b1 s + b2 s^2 + b3 s^3 over 0 <= s <= 1, each (n,)."""
        found, last = np.empty(4), np.zeros_like(b2) if b3 is None else b3
        c0, c1, c2, c3 = (np.ascontiguousarray(b, _FLOAT) for b in (b0, b1, b2, last))
        verdict = _direct(certify_curve)(
            self.model.arrays, c0, c1, c2, c3, float(self.slack), found
        )
        return self._motion(verdict, found)

    def free(self, start: Array, end: Array) -> bool:
        """Whether the straight joint motion is proved free: ``segment`` without the report."""
        a, b = np.ascontiguousarray(start, _FLOAT), np.ascontiguousarray(end, _FLOAT)
        return bool(_direct(certify_edge)(self.model.arrays, a, b, float(self.slack)) == FREE)

    def straight(self, start: Array, end: Array) -> Motion:
        """``segment`` at less cost: it answers no clearance (-inf).

        It checks fifteen states between ``start`` and ``end``, both (n,), before it proves
        anything: they cost less than a proof that fails.
        """
        a, b = np.ascontiguousarray(start, _FLOAT), np.ascontiguousarray(end, _FLOAT)
        found = np.empty(4)
        arrays, slack = self.model.arrays, float(self.slack)
        return self._motion(_direct(check_straight)(arrays, a, b, slack, _CHECKED, found), found)

    def round_corners(
        self, waypoints: Array, reaches: Array, halvings: int, *, keep: bool, smooth: bool
    ) -> Iterator[int]:
        """Find the first of each corner's reach, its half, ... whose ``curve`` is free.

        Args:
            waypoints: Shape (k, n), none that repeats its predecessor.
            reaches: Largest reaches, 0 for corners that are not asked about, shape (k - 2,); filled
                with those found, negative where none is free.
            halvings: Reaches tried at a corner.
            keep: Whether corners that are not ``valid`` themselves are passed over.
            smooth: Whether two cubics of continuous curvature round a corner, or a parabola.

        Yields:
            The number of corners done, whenever the search may be given up.
        """
        points, done = np.ascontiguousarray(waypoints, _FLOAT), 0
        while done < len(reaches):
            done = _direct(round_corners)(
                self.model.arrays, points, float(self.slack), halvings, keep, smooth, done, reaches
            )
            yield done

    def polyline(self, waypoints: Array) -> tuple[Motion, int]:
        """Prove every leg of a polyline (k, n); what was found and the leg it is about."""
        found = np.empty(4)
        points = np.array(waypoints, dtype=np.float64)
        verdict, leg = certify_path(self.model.arrays, points, self.slack, found)
        return self._motion(verdict, found), int(leg)

    def _motion(self, verdict: int, found: Array) -> Motion:
        free = verdict == FREE
        return Motion(
            free=free,
            colliding=verdict == COLLIDING,
            at=1.0 if free else float(found[0]),
            pair=None if free else self.model.pair_name(int(found[1])),
            clearance=float(found[3]) - self.slack,
            intervals=int(found[2]),
        )
