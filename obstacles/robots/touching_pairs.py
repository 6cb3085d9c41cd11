"""Pairs of links that touch in sampled or named configurations, and covers that overlap there.

Where no SRDF says which links may touch, samples tell. Covers may overlap where the solids
themselves are apart: the flange in the fork of a wrist, a hand in the hollow of a forearm. Wherever
such a robot stands, no cover parts them, and their triangles decide, a hundred times as dear; cut
more finely, the covers stay apart.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, Indices
from kinematics.forward import joint_frames
from obstacles.convex.piece import Piece
from obstacles.distance.piece_set import CENTER, POSE, RADIUS, PieceSet
from obstacles.distance.triangles.distance import touching

if TYPE_CHECKING:
    from obstacles.robots.robot_geometry import RobotGeometry

Pair: TypeAlias = tuple[str, str]
Candidates: TypeAlias = dict[Pair, list[tuple[int, int]]]
#: Configurations in which a pair of links must touch, every time, to count as always touching: one
#: that is apart in a hundredth of them passes with a probability of 0.99^1000 = 4e-5.
_ALWAYS_SAMPLES = 1000
_ALWAYS_SEED = 0
#: Configurations for pairs that touch often, in how many of them that is, and in how many it is
#: nearly always. Links that are meant to move past each other touch in a few.
_OFTEN_SAMPLES, _OFTEN, _NEARLY = 100, 40, 95
_OFTEN_SEED = 1
#: Pairs that touched less often than this in the first ones are looked at no more.
_FIRST_SAMPLES, _FIRST_OFTEN = 20, 4
#: Configurations that are looked at, and in how many of them covers must touch in vain.
_COVER_SAMPLES, _IN_VAIN = 60, 6
_COVER_SEED = 2
#: Triangles of all such solids beyond which they stay as they are: cutting them anew would take
#: longer than an upload may, and a humanoid has many.
_MAX_TRIANGLES = 20_000
#: Pieces of a robot beyond which it stays as it is: what is packed and swept of it grows with their
#: square.
_MAX_PIECES = 200


class PlacedPieces:
    """The pieces of a robot, put into one configuration after the other.

    Args:
        robot: The robot.
        pieces: Pieces in place of its own, as many.
    """

    def __init__(self, robot: "RobotGeometry", pieces: Sequence[Piece] | None = None) -> None:
        self._chain = robot.chain
        self._joints: NDArray[np.int64] = robot.joints
        self._packed = PieceSet.of(robot.pieces if pieces is None else pieces)
        count = len(robot.pieces)
        self._owned = np.tile(np.eye(4), (count, 1, 1))
        self._owned[:, :3] = self._packed.rows[:, POSE : POSE + 12].reshape(-1, 3, 4)
        self._centers = np.ones((count, 4, 1))
        self._centers[:, :3, 0] = self._packed.rows[:, CENTER : CENTER + 3]

    def place(self, q: Array) -> None:
        """Put them where they are in a configuration (n,) [rad or m]."""
        frames = np.concatenate([np.eye(4)[None], joint_frames(self._chain, q)])
        carried = frames[self._joints + 1, :3]
        self._packed.rows[:, POSE : POSE + 12] = (carried @ self._owned).reshape(-1, 12)
        self._packed.rows[:, CENTER : CENTER + 3] = (carried @ self._centers)[:, :, 0]

    def may_touch(self, pieces: Indices) -> NDArray[np.bool_]:
        """Whether pairs of pieces (k, 2) have balls about them that touch, shape (k,)."""
        centers, radii = self._packed.rows[:, CENTER : CENTER + 3], self._packed.rows[:, RADIUS]
        first, second = pieces.T
        apart = centers[first] - centers[second]
        # Half-spaces have no ball: their radius is infinite, or not a number.
        is_apart = (apart * apart).sum(axis=1) > (radii[first] + radii[second]) ** 2
        return np.asarray(~is_apart, dtype=np.bool_)

    def touch(self, pieces: Iterable[tuple[int, int]]) -> bool:
        """Whether any of these pairs of pieces touches."""
        return any(touching(self._packed, i, j) for i, j in pieces)


def always_touching(robot: "RobotGeometry", known: Mapping[Pair, str]) -> set[Pair]:
    """Pairs of links that touch in every one of many random configurations.

    Args:
        robot: The robot.
        known: Pairs that need no look.
    """
    candidates = _candidates(robot, known)
    lower, upper = robot.chain.sampling_bounds()
    placed, random = PlacedPieces(robot), np.random.default_rng(_ALWAYS_SEED)
    for _ in range(_ALWAYS_SAMPLES):
        if not candidates:
            break
        placed.place(random.uniform(lower, upper))
        candidates = {pair: own for pair, own in candidates.items() if placed.touch(own)}
    return set(candidates)


def suspected_pairs(robot: "RobotGeometry") -> dict[Pair, str]:
    """Pairs that are checked and touch where a robot surely may stand, each with the reason.

    Looked at are the configuration 0, or the one nearest to it within the limits, the named states
    and random configurations, in two fifths of which a pair must touch.

    Args:
        robot: The robot with its named states.
    """
    candidates, placed = _candidates(robot, {}), PlacedPieces(robot)
    limits = robot.chain.limits
    poses = {"zero pose": np.clip(np.zeros(robot.chain.n), limits.lower, limits.upper)}
    poses |= {f"state {name!r}": q for name, q in robot.states.items()}
    suspected: dict[Pair, str] = {}
    for reason, q in poses.items():
        placed.place(q)
        met = [pair for pair, own in candidates.items() if placed.touch(own)]
        suspected |= {pair: reason for pair in met if pair not in suspected}
    for pair, count in _often(robot, candidates, placed).items():
        reason = f"in {count} of {_OFTEN_SAMPLES} random configurations"
        suspected.setdefault(pair, "nearly always" if count >= _NEARLY else reason)
    return suspected


def _often(robot: "RobotGeometry", candidates: Candidates, placed: PlacedPieces) -> dict[Pair, int]:
    """Pairs that touch often, and in how many of the random configurations."""
    lower, upper = robot.chain.sampling_bounds()
    random = np.random.default_rng(_OFTEN_SEED)
    touched = dict.fromkeys(candidates, 0)
    for sample in range(_OFTEN_SAMPLES):
        if not touched:
            break
        placed.place(random.uniform(lower, upper))
        for pair in list(touched):
            touched[pair] += placed.touch(candidates[pair])
            if sample + 1 == _FIRST_SAMPLES and touched[pair] < _FIRST_OFTEN:
                del touched[pair]
    return {pair: count for pair, count in touched.items() if count >= _OFTEN}


def _candidates(robot: "RobotGeometry", known: Mapping[Pair, str]) -> Candidates:
    """Pairs of pieces by the links they belong to, of links that may not touch."""
    candidates: Candidates = {}
    for i, j in robot.self_pairs:
        pair = min(robot.links[i], robot.links[j]), max(robot.links[i], robot.links[j])
        if pair not in known:
            candidates.setdefault(pair, []).append((int(i), int(j)))
    return candidates


def overlapping_covers(robot: "RobotGeometry") -> set[int]:
    """Numbers of the solids whose covers often touch another's that they are apart from.

    Args:
        robot: The robot.
    """
    if not 0 < len(robot.pieces) <= _MAX_PIECES:
        return set()
    surfaces = np.array([piece.surface is not None for piece in robot.pieces])
    pairs = robot.self_pairs[surfaces[robot.self_pairs].any(axis=1)]
    if not len(pairs):
        return set()
    bare = [replace(piece, surface=None) for piece in robot.pieces]
    exact, covers = PlacedPieces(robot), PlacedPieces(robot, bare)
    lower, upper = robot.chain.sampling_bounds()
    random, in_vain = np.random.default_rng(_COVER_SEED), Counter[tuple[int, int]]()
    solids = robot.solids[pairs]
    for _ in range(_COVER_SAMPLES):
        q = random.uniform(lower, upper)
        covers.place(q)
        exact.place(q)
        near = covers.may_touch(pairs)
        together = defaultdict[tuple[int, int], list[tuple[int, int]]](list)
        for pair, (a, b) in zip(pairs[near].tolist(), solids[near].tolist(), strict=True):
            together[a, b].append((pair[0], pair[1]))
        for pair, pieces in together.items():
            known = in_vain[pair] >= _IN_VAIN
            in_vain[pair] += not known and covers.touch(pieces) and not exact.touch(pieces)
    overlapping = {solid for pair, count in in_vain.items() if count >= _IN_VAIN for solid in pair}
    triangles = Counter[int]()
    for solid, piece in zip(robot.solids, robot.pieces, strict=True):
        if piece.surface is not None and int(solid) in overlapping:
            triangles[int(solid)] += len(piece.surface.triangles)
    return set(triangles) if triangles.total() <= _MAX_TRIANGLES else set()
