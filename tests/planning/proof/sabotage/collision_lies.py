"""Lies about collisions: checks, packed scenes, pairs, shortcuts and blended corners."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from kinematics.arrays import Array
from obstacles.collision.checker import Checker, Motion
from obstacles.collision.model.brackets import OUTER
from obstacles.collision.model.collision_model import CollisionModel, skipped_pairs
from obstacles.distance.bvh import Tree, tree
from obstacles.distance.piece_set import RADIUS
from obstacles.robots.robot_geometry import RobotGeometry, hulled
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Cylinder, Shape
from planning.constrained.checker import round_one_by_one
from planning.search.shortcut import shortcut
from planning.timing.path.blend import blend, certified_reaches, largest_reaches
from tests.planning.proof.sabotage.cases import case
from tests.planning.proof.sabotage.trial import Lie, Sabotage

#: What solids are shrunk to.
_SMALLER = 0.3


_COLLISION = frozenset({"collision"})


_BLOCKED = (
    "panda around a post", "ur5e around a wall", "elbow around a post", "dh arm around a post",
)  # fmt: skip


#: With corners that may not be cut.
_ANOTHER_WAY = (
    "panda around a post another way", "ur5e around a wall another way",
    "elbow around a post another way",
)  # fmt: skip


_EVERY_BLOCKED = (
    *_BLOCKED, "panda around a post, jerk limited", "panda around a post, by splines",
    "panda past a post with a margin", "panda unfolding",
)  # fmt: skip


def _free(self: Checker, *_: Any) -> Motion:
    return Motion(True, False, 1.0, None, 1.0, 1)


def _state_check(sabotage: Sabotage) -> None:
    """Ends are always valid, and edges leave them to the state check."""
    true = Checker.segment

    def between(self: Checker, start: Array, end: Array) -> Motion:
        return true(self, start + 0.4 * (end - start), end - 0.4 * (end - start))

    sabotage.method(Checker, "valid", lambda self, q: True)
    sabotage.method(Checker, "all_valid", lambda self, states: True)
    sabotage.method(Checker, "clearance", lambda self, q: (1.0, None))
    sabotage.method(Checker, "segment", between)
    sabotage.method(Checker, "free", lambda self, start, end: between(self, start, end).free)
    sabotage.method(Checker, "straight", between)


def _edge_check(sabotage: Sabotage) -> None:
    sabotage.method(Checker, "free", lambda self, start, end: True)
    sabotage.method(Checker, "straight", _free)
    sabotage.method(Checker, "segment", _free)
    sabotage.method(Checker, "curve", _free)
    sabotage.method(Checker, "polyline", lambda self, points: (_free(self), len(points) - 1))
    sabotage.method(Checker, "round_corners", round_one_by_one)


def _edge_check_at_ends(sabotage: Sabotage) -> None:
    def segment(self: Checker, start: Array, end: Array) -> Motion:
        if self.valid(start) and self.valid(end):
            return _free(self)
        return Motion(False, True, 0.0, ("one", "other"), -np.inf, 2)

    sabotage.method(Checker, "straight", segment)
    sabotage.method(Checker, "segment", segment)
    sabotage.method(Checker, "free", lambda self, start, end: segment(self, start, end).free)
    sabotage.method(
        Checker, "curve", lambda self, b0, b1, b2, b3=0.0: segment(self, b0, b0 + b1 + b2 + b3)
    )
    sabotage.method(Checker, "round_corners", round_one_by_one)


def _modelled(model: Callable[..., CollisionModel]) -> Callable[[Sabotage], None]:
    """A lie in the models of a robot in a scene, which every kernel of the planners reads."""

    def of(cls: type[Checker], robot: RobotGeometry, scene: Scene, margin: float = 0.0) -> Checker:
        return cls(model(robot, scene, margin))

    return lambda sabotage: sabotage.method(Checker, "of", classmethod(of))


def _packed(
    doctored: Callable[[RobotGeometry, Scene, float], tuple[RobotGeometry, Scene, float]],
) -> Callable[[Sabotage], None]:
    """A lie that packs something else than it is given."""
    return _modelled(lambda robot, scene, margin: CollisionModel(*doctored(robot, scene, margin)))


def _shrunk(shape: Shape) -> Shape:
    if isinstance(shape, Box):
        return Box(_SMALLER * shape.size)
    assert isinstance(shape, Cylinder)
    return Cylinder(_SMALLER * shape.radius, shape.height)


def _shrunk_scene(scene: Scene) -> Scene:
    return Scene(tuple(replace(o, shape=_shrunk(o.shape)) for o in scene.obstacles))


def _shrunk_robot(robot: RobotGeometry) -> RobotGeometry:
    pieces = tuple(
        replace(
            piece, vertices=_SMALLER * piece.vertices, radius=_SMALLER * piece.radius,
            half_height=_SMALLER * piece.half_height, surface=None,
        )
        for piece in robot.pieces
    )  # fmt: skip
    return replace(robot, pieces=pieces)


def _without_scene(scene: Scene) -> Scene:
    far = np.diag([1.0, 1.0, 1.0, 1.0])
    far[2, 3] = -50.0
    return Scene(tuple(Obstacle(o.id, o.shape, far) for o in scene.obstacles))


def _own_pairs_allowed(robot: RobotGeometry) -> RobotGeometry:
    names = robot.names
    everything = {(min(a, b), max(a, b)): "srdf" for a in names for b in names if a != b}
    return replace(robot, allowed=everything)


def _small_balls(robot: RobotGeometry, scene: Scene, margin: float) -> CollisionModel:
    """The balls that hold solids, which decide first, have no size; spheres that cover likewise."""
    model = CollisionModel(robot, scene, margin)
    arrays = model.arrays
    rows, around, spheres = (np.array(a) for a in (arrays.robot, arrays.scene, arrays.spheres))
    rows[:, RADIUS], around[:, RADIUS], spheres[:, OUTER] = 0.0, 0.0, 0.0
    doctored = arrays._replace(robot=rows, scene=around, spheres=spheres)
    object.__setattr__(model, "arrays", doctored)
    return model


def _tree_elsewhere(sabotage: Sabotage) -> None:
    """The boxes over the scene's solids hang fifty metres above them."""

    def grown(true: Callable[..., Tree], low: Array, high: Array, *more: Any) -> Tree:
        up = np.array([0.0, 0.0, 50.0])
        return true(low + up, high + up, *more)

    sabotage.wrap(tree, grown)


def _pairs_skipped(sabotage: Sabotage) -> None:
    """All pairs with links of which something meets an obstacle in the cases."""

    def skipped(true: Callable[..., Any], robot: RobotGeometry, scene: Scene) -> Any:
        return np.ones_like(true(robot, scene))

    sabotage.wrap(skipped_pairs, skipped)


def _own_pairs_dropped(sabotage: Sabotage) -> None:
    for name in ("panda unfolding",):
        robot = case(name).problem.robot
        sabotage.value(robot, "self_pairs", np.zeros((0, 2), dtype=np.int64))


def _small_hulls(sabotage: Sabotage) -> None:
    sabotage.wrap(hulled, lambda true, robot: _shrunk_robot(true(robot)))


def _shortcut_to_the_end(sabotage: Sabotage) -> None:
    sabotage.replace(shortcut, lambda checker, waypoints, *_, **__: waypoints[[0, -1]])


def _shortcut_in_an_empty_scene(sabotage: Sabotage) -> None:
    def emptied(value: Any) -> Any:
        if not isinstance(value, Checker):
            return value
        model = value.model
        empty = CollisionModel(model.robot, _without_scene(model.scene), model.margin)
        return Checker(empty, value.slack)

    def blind(true: Callable[..., Array], *values: Any, **named: Any) -> Array:
        return true(*map(emptied, values), **named)

    sabotage.wrap(shortcut, blind)


def _corners_rounded_fully(sabotage: Sabotage) -> None:
    def fully(checker: Checker, waypoints: Array, *_: Any, **__: Any) -> Array:
        return largest_reaches(waypoints)

    sabotage.replace(certified_reaches, fully)


def _corners_rounded_wider(sabotage: Sabotage) -> None:
    """A corner is rounded four times as wide as was asked for."""

    def wider(
        true: Callable[..., Any], waypoints: Any, reaches: Any, *more: Any, **how: Any
    ) -> Any:
        wide = np.minimum(4.0 * np.asarray(reaches), largest_reaches(waypoints))
        return true(waypoints, wide, *more, **how)

    sabotage.wrap(blend, wider)


COLLISION_LIES = (
    Lie("state check", "always valid", _state_check,
        ("panda starting in a box", "panda ending in a box"), _COLLISION),
    Lie("edge check", "always free", _edge_check,
        (*_EVERY_BLOCKED, "panda along a blocked line"), _COLLISION),
    Lie("edge check", "looks at the ends alone", _edge_check_at_ends,
        (*_EVERY_BLOCKED, "panda straight through a post"), _COLLISION),
    Lie("packed scene", "obstacles shrunk", _packed(lambda r, s, m: (r, _shrunk_scene(s), m)),
        (*_BLOCKED, "ur5e around a wall, by random trees"), _COLLISION),
    Lie("packed scene", "an obstacle dropped", _packed(lambda r, s, m: (r, _without_scene(s), m)),
        (*_BLOCKED, "hook over a bar"), _COLLISION),
    Lie("packed robot", "solids shrunk", _packed(lambda r, s, m: (_shrunk_robot(r), s, m)),
        _BLOCKED, _COLLISION),
    Lie("packed robot", "balls around solids shrunk",
        _modelled(_small_balls), _BLOCKED, _COLLISION),
    Lie("margin", "taken for 0", _packed(lambda r, s, m: (r, s, 0.0)),
        ("panda past a post with a margin",), _COLLISION),
    Lie("hull cover", "smaller than what it holds", _small_hulls, ("hook over a bar",),
        _COLLISION),
    Lie("pair choice", "obstacles skipped", _pairs_skipped, (*_BLOCKED, "hook over a bar"),
        _COLLISION),
    Lie("pair choice", "own pairs allowed",
        _packed(lambda r, s, m: (_own_pairs_allowed(r), s, m)), ("panda unfolding",), _COLLISION),
    Lie("shortcut", "straight to the end", _shortcut_to_the_end, _BLOCKED, _COLLISION),
    Lie("shortcut", "in an empty scene", _shortcut_in_an_empty_scene, _BLOCKED, _COLLISION),
    Lie("corner blending", "every corner rounded fully", _corners_rounded_fully,
        _ANOTHER_WAY, _COLLISION),
    Lie("corner blending", "corners rounded wider than proved", _corners_rounded_wider,
        _ANOTHER_WAY, _COLLISION),
    Lie("packed scene", "box tree elsewhere", _tree_elsewhere, _BLOCKED, _COLLISION),
    Lie("pair choice", "own pairs dropped", _own_pairs_dropped, ("panda unfolding",), _COLLISION),
)  # fmt: skip
