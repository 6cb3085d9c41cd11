"""Pairs of solids that may touch: who allows each, and how deep they may be.

The one place that says which pairs are not kept apart. What each certificate and each check tells
of them is made from this table.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from kinematics.arrays import Indices
from kinematics.caches.bounded_cache import bounded_cache
from obstacles.robots.robot_geometry import RobotGeometry, sorted_pair
from obstacles.scenes.scene import AllowedContact, Pair, Scene

#: How deep what is named in ``touch_links`` or ``support`` may go, unless told otherwise [m].
TOUCH_DEPTH = 1e-3
#: A depth beyond the one allowed by less than this is a rounding error [m].
DEPTH_TOLERANCE = 1e-6
#: Reasons for pairs that overlap as the robot is built, where its joints are or always.
_AS_BUILT = frozenset({"adjacent", "always", "same body"})


class AllowedPair(NamedTuple):
    """A pair that is not kept apart.

    Args:
        pair: Two names, sorted; one is of a link or of what it holds.
        reason: Reason: who allows the pair.
        touch_depth: How deep the two may overlap [m]; infinite for any depth.
        measured: Whether the depth of the pair is reported: not of links that a joint joins, nor of
            those that touch as the robot is built, where its model overlaps itself.
    """

    pair: Pair
    reason: str
    touch_depth: float
    measured: bool

    @property
    def limited(self) -> bool:
        """Whether there is a depth that the two must not exceed."""
        return self.touch_depth < np.inf

    def deeper(self, depth: float) -> tuple[str, dict[str, Any]]:
        """Fault of a pair that is deeper than it may be, in words and as values a program can use.

        Args:
            depth: How deep they are [m].
        """
        a, b = self.pair
        message = (
            f"{a!r} and {b!r} overlap by {depth:.4g} m, touch_depth is {self.touch_depth:.4g} m"
        )
        details = {"pair": [a, b], "depth": depth, "touch_depth": self.touch_depth}
        return message, details | {"distance": -depth, "margin": 0.0}


class Overlap(NamedTuple):
    """A pair that is not kept apart, with how deep it is.

    Args:
        pair: Two names, sorted.
        reason: Reason: who allows the pair.
        overlap: The deepest overlap of two convex pieces of theirs [m]; None where none is told.
    """

    pair: Pair
    reason: str
    overlap: float | None


def deepest(*motions: Sequence[Overlap]) -> tuple[Overlap, ...]:
    """All pairs of some motions, each as deep as it is in the deepest of them."""
    merged: dict[Pair, Overlap] = {}
    for item in chain.from_iterable(motions):
        known = merged.setdefault(item.pair, item)
        if (item.overlap or 0.0) > (known.overlap or 0.0):
            merged[item.pair] = item
    return tuple(merged[pair] for pair in sorted(merged))


def contacts_of(pairs: Iterable[Pair], reason: str) -> dict[Pair, AllowedContact]:
    """Contacts of any depth for pairs of names; those that have a depth keep it.

    Args:
        pairs: Pairs of names, or such pairs with their contacts.
        reason: Reason of those that do not say so.
    """
    known = pairs if isinstance(pairs, Mapping) else {}
    made = ((sorted_pair(*pair), known.get(pair)) for pair in pairs)
    return {pair: contact or AllowedContact(reason) for pair, contact in made}


def allowed_pairs(robot: RobotGeometry, scene: Scene) -> tuple[AllowedPair, ...]:
    """All pairs of a robot in a scene that may touch, sorted, whoever allows them.

    What a scene or a request says of a pair counts before what the robot's own SRDF says.

    Args:
        robot: Robot with the pieces of what it holds.
        scene: Scene around the robot.
    """
    contacts = frozenset(scene.contacts.items())
    return _table(robot, frozenset(scene.ids), scene.allowed_collisions, contacts)


@bounded_cache(maxsize=16)
def _table(
    robot: RobotGeometry,
    ids: frozenset[str],
    allowed: frozenset[Pair],
    contacts: frozenset[tuple[Pair, AllowedContact]],
) -> tuple[AllowedPair, ...]:
    own, given = frozenset(robot.names), dict(contacts)
    solid, joined = own | ids, _joined(robot)
    table = []
    for pair in sorted(robot.allowed.keys() | allowed):
        if not (solid.issuperset(pair) and own.intersection(pair)):
            continue
        reason = robot.allowed.get(pair, "")
        if pair in allowed:
            contact = given.get(pair, AllowedContact())
            table.append(AllowedPair(pair, contact.reason, contact.touch_depth, measured=True))
        else:
            as_built = reason in _AS_BUILT and all(name in robot.chain.index for name in pair)
            measured = not as_built and pair not in joined
            table.append(AllowedPair(pair, reason, np.inf, measured))
    return tuple(table)


def _joined(robot: RobotGeometry) -> frozenset[Pair]:
    """Pairs of links on two bodies that a joint joins."""
    n, mimic_joints = robot.chain.n, robot.chain.mimic_joints
    before = {j: j - 1 for j in range(n)}
    before |= {k: mimic.parent for k, mimic in enumerate(mimic_joints, start=n)}
    bodies = {name: int(j) for name, j in zip(robot.links, robot.joints, strict=True)}
    bodies = {name: body for name, body in bodies.items() if name in robot.chain.index}
    return frozenset(
        sorted_pair(name, other)
        for name, body in bodies.items()
        for other, inner in bodies.items()
        if before.get(body) == inner
    )


def piece_pairs(robot: RobotGeometry, scene: Scene, pair: Pair) -> Indices:
    """Pairs of pieces of two bodies, one of them the robot's, shape (k, 2).

    The robot's pieces come first, then those of the obstacles in their order.

    Args:
        robot: The robot.
        scene: Scene around the robot.
        pair: The names of the two.
    """
    rows = []
    for name in pair:
        own = np.flatnonzero([link == name for link in robot.links])
        if not len(own):
            owners = scene.pieces()[1]
            own = len(robot.links) + np.flatnonzero(owners == scene.ids.index(name))
        rows.append(own)
    first, second = np.meshgrid(*rows, indexing="ij")
    return np.sort(np.column_stack([first.ravel(), second.ravel()]), axis=1)
