"""A robot and a scene packed for the kernels; each is prepared once and kept by its content."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Indices
from kinematics.caches.bounded_cache import DEFAULT_LIMIT, array_bytes, bounded_cache
from kinematics.model.chain import Chain
from obstacles.collision.model.brackets import Brackets, brackets, sphere_sets
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.model.pair_grid import PairGrid, pair_grid
from obstacles.collision.model.pair_groups import chosen_groups, pair_groups, whole_groups
from obstacles.distance.bvh import Tree, tree
from obstacles.distance.piece_set import (
    GROUP,
    GROUP_STOP,
    HALF,
    KIND,
    MARGIN,
    MIDDLE,
    OWNER,
    POSE,
    CoreKind,
    PieceSet,
)
from obstacles.distance.scene_set import scene_set
from obstacles.robots.robot_geometry import RobotGeometry, touch_matrix
from obstacles.scenes.scene import Scene

__all__ = ["CollisionModel", "ModelArrays", "all_pieces", "pack", "skipped_pairs"]

_T = TypeVar("_T", bound=np.generic)
_HALFSPACE = int(CoreKind.HALFSPACE)
#: The first of the margins, which come last.
_MARGIN = ModelArrays._fields.index("margin")


@dataclass(frozen=True, eq=False)
class CollisionModel:
    """Model of a robot in a scene for collision verdicts, packed when first asked.

    Every link is compared with every obstacle, and with those links that it may collide with. What
    stands still with the base can't be planned out of anything and is not compared with obstacles;
    pairs that the scene or the robot allows are left out.

    Args:
        robot: Chain and solids.
        scene: Scene around the robot.
        margin: Margin from obstacles, beyond their own [m].
        own_margin: Margin of self-collision pairs [m], which may be built close together.
        _like: Model that differs in margins alone, if there is one.
    """

    robot: RobotGeometry
    scene: Scene
    margin: float = 0.0
    own_margin: float = 0.0
    _like: "CollisionModel | None" = field(default=None, repr=False)

    @cached_property
    def arrays(self) -> ModelArrays:
        """Arrays of the model for kernels."""
        like = self._like
        packed = _packed(self.robot, self.scene) if like is None else like.arrays
        # ``_replace`` would take three times as long.
        return ModelArrays._make((*packed[:_MARGIN], float(self.margin), float(self.own_margin)))

    def with_margins(self, margin: float, own_margin: float) -> "CollisionModel":
        """Model of this robot and scene with other margins from obstacles and between links [m]."""
        return CollisionModel(self.robot, self.scene, margin, own_margin, self)

    @classmethod
    def bare(cls, chain: Chain) -> "CollisionModel":
        """A robot without solids where there is nothing."""
        none = np.zeros(0, dtype=np.int64)
        return cls(RobotGeometry(chain, (), (), none, none, {}), Scene())

    def pair_name(self, pair: int) -> tuple[str, str]:
        """Names of the two bodies of a pair, the link that moves first.

        Pair i m + k is piece i of the robot and piece k of the scene, p m + s the robot's pair s.
        """
        arrays, links = self.arrays, self.robot.links
        p, m = len(links), len(arrays.scene)
        if pair >= p * m:
            i, j = arrays.self_pairs[pair - p * m]
            return links[j], links[i]
        return links[pair // m], self.scene.ids[int(arrays.scene[pair % m, OWNER])]


@bounded_cache(maxsize=16, weigh=array_bytes)
def _packed(robot: RobotGeometry, scene: Scene) -> ModelArrays:
    scene.check_placed()
    own, around = _robot_part(robot), _scene_part(scene)
    skipped = skipped_pairs(robot, scene)
    robot_set = own.pieces.behind(around.pieces)
    if robot_set is not own.pieces:  # which are read-only already
        for array in robot_set:
            array.setflags(write=False)
    met_things, allowed = len(around.tree.items) > 0, scene.allowed_collisions
    searches = _searches(robot, allowed, skipped.tobytes(), len(scene.ids), met_things)
    roots = searches.roots
    if len(around.halfspaces):
        roots = _with_halfspaces(roots, searches.moving, met_things, skipped, around)
    return ModelArrays(
        chain=robot.chain.model,
        joints=own.carriers,
        robot=robot_set.rows,
        scene=around.pieces.rows,
        corners=robot_set.corners,
        tables=robot_set.tables,
        surfaces=robot_set.surfaces,
        self_pairs=searches.self_pairs,
        groups=searches.groups,
        grid_axes=searches.grid.axes,
        grid_starts=searches.grid.starts,
        grid_values=searches.grid.values,
        nodes=around.tree.nodes,
        items=around.tree.items,
        skipped=skipped,
        spheres=own.brackets.spheres,
        sphere_starts=own.brackets.starts,
        bodies=searches.bodies,
        carried=searches.carried,
        halfspaces=around.halfspaces,
        roots=roots,
        margin=0.0,
        own_margin=0.0,  # those of a model are put in their place
    )


def pack(robot: RobotGeometry) -> None:
    """Pack a robot beforehand: what takes longest is kept (`kept_files`)."""
    sphere_sets(robot)  # of a robot in memory too: what it was packed for may be gone
    pair_grid(robot.chain, robot.pieces, robot.joints, _robot_part(robot).pairs)


def all_pieces(robot: RobotGeometry, scene: Scene) -> PieceSet:
    """The pieces of a robot, each in the frame of its joint, and behind them those of a scene."""
    own, around = _robot_part(robot).pieces, _scene_part(scene).pieces
    behind = own._replace(rows=own.rows[: len(robot.pieces)]).behind(around)
    rows = np.vstack([behind.rows, around.rows])
    grouped = rows[len(robot.pieces) :, GROUP_STOP] > 0.0
    rows[len(robot.pieces) :, GROUP : GROUP_STOP + 1][grouped] += len(robot.pieces)
    return behind._replace(rows=_readonly(rows))


def skipped_pairs(robot: RobotGeometry, scene: Scene) -> NDArray[np.bool_]:
    """Contacts allowed between pieces of a robot and obstacles, shape (p, obstacles); read-only.

    Those may that stand still with the base, and those whose link the scene allows to.
    """
    return _skipped_in(robot, scene.ids, scene.allowed_collisions)


#: Scenes that differ in where things are often have the same names.
@bounded_cache(maxsize=16, weigh=array_bytes)
def _skipped_in(
    robot: RobotGeometry, ids: tuple[str, ...], allowed: frozenset[tuple[str, str]]
) -> NDArray[np.bool_]:
    """``skipped_pairs`` with obstacles of these names."""
    skipped = np.zeros((len(robot.pieces), len(ids)), dtype=np.bool_)
    skipped[robot.joints < 0] = True
    if allowed:
        column = {name: k for k, name in enumerate(ids)}
        # Most that scenes allow is of the robot's own links.
        for pair in (pair for pair in allowed if pair[0] in column or pair[1] in column):
            for link, obstacle in (pair, pair[::-1]):
                if obstacle in column:
                    rows = [i for i, name in enumerate(robot.links) if name == link]
                    skipped[rows, column[obstacle]] = True
    return _readonly(skipped)


class _RobotPart(NamedTuple):
    """A robot's rows, pieces and then balls, what carries them, and its pairs by groups."""

    pieces: PieceSet
    carriers: Indices
    bodies: Mapping[int, int]
    pairs: Indices
    groups: Indices
    grid: PairGrid
    brackets: Brackets


class _Searches(NamedTuple):
    """Starts of searches and what they compare, columns as in ``ModelArrays``.

    ``moving`` are the pieces that meet things, outermost first.
    """

    self_pairs: Indices
    grid: PairGrid
    groups: Indices
    bodies: Indices
    carried: Indices
    moving: Indices
    roots: Indices


class _ScenePart(NamedTuple):
    pieces: PieceSet
    tree: Tree
    halfspaces: Indices


@bounded_cache(maxsize=64, limit=4 * DEFAULT_LIMIT)  # a plan's fine solids, and their hulls
def _robot_part(robot: RobotGeometry) -> _RobotPart:
    order = np.argsort(robot.joints[robot.self_pairs], axis=1, kind="stable")
    pairs = np.take_along_axis(robot.self_pairs, order, axis=1)
    pairs = pairs[np.lexsort(robot.joints[pairs[:, ::-1]].T)]
    packed, p = PieceSet.of(robot.pieces), len(robot.pieces)
    by_groups = pair_groups(packed.rows, robot.joints, pairs)
    pairs, groups = _readonly(by_groups.pairs), _readonly(by_groups.groups)
    grid = pair_grid(robot.chain, robot.pieces, robot.joints, pairs)
    bodies = {int(joint): p + k for k, joint in enumerate(np.unique(robot.joints))}
    carriers = _readonly(np.concatenate([robot.joints, by_groups.joints]))
    own = packed._replace(rows=_readonly(np.vstack([packed.rows, by_groups.balls])))
    for array in own:
        array.setflags(write=False)
    return _RobotPart(own, carriers, bodies, pairs, groups, grid, brackets(robot))


def _self_pairs(
    robot: RobotGeometry, allowed: frozenset[tuple[str, str]]
) -> tuple[Indices, PairGrid, Indices]:
    """The robot's pairs but for those that are allowed, their grids and ``ModelArrays.groups``."""
    own = _robot_part(robot)
    links, may_touch = touch_matrix(robot.links, allowed)
    chosen = ~may_touch[links[own.pairs[:, 0]], links[own.pairs[:, 1]]]
    grid = PairGrid(
        _readonly(own.grid.axes[chosen]), _readonly(own.grid.starts[chosen]),
        _readonly(own.grid.values),
    )  # fmt: skip
    return _readonly(own.pairs[chosen]), grid, _readonly(chosen_groups(own.groups, chosen))


#: In scenes that allow the same, and most allow nothing, a robot's are the same.
@bounded_cache(maxsize=64)
def _searches(
    robot: RobotGeometry, allowed: frozenset[tuple[str, str]], skipped: bytes, obstacles: int,
    met_things: bool,
) -> _Searches:  # fmt: skip
    """Searches in a scene, those against half-spaces left out.

    Args:
        robot: The robot.
        allowed: Pairs of names that may touch.
        skipped: Bytes of ``skipped_pairs``.
        obstacles: How many there are.
        met_things: Whether there is anything that is no half-space.
    """
    self_pairs, grid, groups = _self_pairs(robot, allowed)
    mask = np.frombuffer(skipped, dtype=np.bool_).reshape(len(robot.pieces), obstacles)
    bodies, carried, moving = _bodies(robot, np.asarray(~mask.all(axis=1)))
    # What is carried farthest out meets things first.
    first = moving if met_things else moving[:0]
    whole = whole_groups(groups)
    roots = np.zeros((len(first) + len(whole), 2), dtype=np.int64)
    roots[: len(first), 0], roots[: len(first), 1] = first, -1
    roots[len(first) :, 0] = -1 - whole
    return _Searches(self_pairs, grid, groups, bodies, carried, moving, _readonly(roots))


def _bodies(robot: RobotGeometry, meets: NDArray[np.bool_]) -> tuple[Indices, Indices, Indices]:
    """``ModelArrays.bodies`` and ``carried``, and the pieces that meet things, outermost first."""
    rows = _robot_part(robot).bodies
    outermost = np.argsort(-robot.joints, kind="stable")
    carried = outermost[(meets & (robot.joints >= 0))[outermost]]
    # All moving bodies, for their balls: some may have no piece that meets anything.
    moving = sorted((joint for joint in rows if joint >= 0), reverse=True)
    last = np.searchsorted(-robot.joints[carried], -np.array(moving, dtype=np.int64), side="right")
    first = np.concatenate([[0], last[:-1]]) if len(last) else last
    bodies = np.column_stack([[rows[joint] for joint in moving], first, last])
    bodies = bodies.astype(np.int64).reshape(-1, 3)
    return _readonly(bodies), _readonly(carried), _readonly(outermost[meets[outermost]])


@bounded_cache(maxsize=16, weigh=array_bytes)
def _scene_part(scene: Scene) -> _ScenePart:
    packed = scene_set(scene)
    rows = packed.rows.copy()
    counts = np.array([obstacle.count for obstacle in scene.obstacles], dtype=np.int64)
    margins = np.array([obstacle.margin for obstacle in scene.obstacles], dtype=np.float64)
    rows[:, OWNER] = np.repeat(np.arange(len(counts)), counts)
    rows[:, MARGIN] = np.repeat(margins, counts)
    solid = rows[:, KIND] != _HALFSPACE
    bounded, halfspaces = rows[solid], np.flatnonzero(~solid)
    pose, middle = bounded[:, POSE : POSE + 12].reshape(-1, 3, 4), bounded[:, MIDDLE : MIDDLE + 3]
    half = np.zeros_like(middle)
    center = np.zeros_like(middle)
    for k in range(3):
        center += pose[:, :, k] * middle[:, k : k + 1]
        half += np.abs(pose[:, :, k]) * bounded[:, HALF + k : HALF + k + 1]
    center, half = center + pose[:, :, 3], half + bounded[:, MARGIN : MARGIN + 1]
    grown = tree(center - half, center + half)
    items = np.flatnonzero(solid)[grown.items]
    for array in (rows, halfspaces, items):
        array.setflags(write=False)
    return _ScenePart(packed._replace(rows=rows), Tree(grown.nodes, items), halfspaces)


def _with_halfspaces(
    roots: Indices, moving: Indices, met_things: bool, skipped: NDArray[np.bool_],
    around: _ScenePart,
) -> Indices:  # fmt: skip
    """Roots with those of searches against half-spaces, which come before self-collision pairs."""
    owners = around.pieces.rows[:, OWNER].astype(np.int64)
    halfspaces = [(i, k) for i in moving for k in around.halfspaces if not skipped[i, owners[k]]]
    first = len(moving) if met_things else 0
    against = np.array(halfspaces, dtype=np.int64).reshape(-1, 2)
    return _readonly(np.concatenate([roots[:first], against, roots[first:]]))


def _readonly(array: NDArray[_T]) -> NDArray[_T]:
    array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array
