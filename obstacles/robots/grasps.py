"""Grasps of a shape: places where two fingers hold it between them, or a cup sits flat on it.

Two points are antipodal where the line through them meets the surface at both nearly head on: what
two fingers press there does not slip within the cone of friction. Points are drawn on the surface;
whether arm and gripper have room is for a planner to find out.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, numbers, typed
from kinematics.errors import InvalidOption
from kinematics.pose import align_z, inverse, rotation_z, transform
from obstacles.convex.triangles import Triangles, join, piece_triangles
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.shapes.shape import HalfSpace, Mesh, Shape

GraspKind = Literal["antipodal", "top", "side", "suction"]
#: Points drawn for each grasp that is asked for, most of which have no opposite.
_DRAWN = 12
#: Cosine of the angle within which two fingers move against each other.
_OPPOSITE = 0.99
#: Approaches this near to a direction count as of it: 30 degrees.
_NEAR = math.cos(math.pi / 6.0)
#: The rim of a cup may be so far off the plane that it sits on [m], looked at from above.
_FLAT, _ABOVE = 1e-3, 0.01
_RIM = 8
#: Hits of a line nearer than this are one [m].
_SAME = 1e-9
_Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True)
class GraspSearch:
    """How grasps are looked for.

    Args:
        kind: "antipodal" for two fingers from anywhere, "top" and "side" for those from above and
            level; "suction" for a cup.
        count: Most grasps.
        angles: Approaches about the line between the fingers, or turns of a cup.
        friction: Coefficient of friction at the fingers.
        depth: How far the tip goes beyond the middle of the two points [m].
        radius: Radius in which a surface is flat under a cup [m].
        seed: Seed of the points.
    """

    kind: GraspKind
    count: int = 24
    angles: int = 8
    friction: float = 0.4
    depth: float = 0.0
    radius: float = 0.01
    seed: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class JawSpan:
    """Two fingers that move towards each other.

    Args:
        axis: Direction between them in the frame of the tip, shape (3,).
        widest: Largest distance between them [m].
    """

    axis: Array
    widest: float


@typed
def jaw_span(robot: RobotGeometry) -> JawSpan:
    """The span of a gripper, by the two fingers that move farthest apart.

    Args:
        robot: The arm with its gripper.

    Raises:
        InvalidOption: No two fingers with solids move against each other.
    """
    fingers, chain = robot.fingers, robot.chain
    low, high = dict(fingers.positions), dict(fingers.positions)
    for name in fingers.positions:
        limits = fingers.limits(name)
        if math.isfinite(limits.lower) and math.isfinite(limits.upper):
            low[name], high[name] = limits.lower, limits.upper
    ends = [fingers.link_poses(chain, positions) for positions in (low, high)]
    R = chain.tip.T_joint_link[:3, :3].T * np.array([[1.0], [1.0], [0.0]])  # across the tool
    ways = [R @ (ends[1][k] - ends[0][k])[:3, 3] for k in ends[0] if k in robot.names]
    pairs = ((a, b) for a in ways for b in ways)
    one, other = max(pairs, key=lambda ab: np.linalg.norm(ab[0] - ab[1]), default=(_Z, _Z))
    widest = float(np.linalg.norm(one - other))
    # Of three jaws no two move against each other.
    against = one @ other <= -_OPPOSITE * np.linalg.norm(one) * np.linalg.norm(other)
    if not widest > 0.0 or not against:
        raise InvalidOption(
            "grasps can't be found: no two fingers of the robot move against each other",
            hint='Mount a tool with jaws, such as "tool": "parallel_jaw", or give poses.',
        )
    return JawSpan((one - other) / widest, widest)


@typed
def find_grasps(shape: Shape, down: ArrayLike, search: GraspSearch, span: JawSpan | None) -> Array:
    """Poses T_object_tool of grasps, the most central first, shape (k, 4, 4); k may be 0.

    The tool comes along its z.

    Args:
        shape: The object in its own frame.
        down: Direction of gravity in that frame, shape (3,).
        search: Kind and number of the grasps.
        span: The fingers; None for a cup.

    Raises:
        InvalidOption: The shape is a half-space.
    """
    below = numbers(down, "down", (3,))
    length = float(np.linalg.norm(below))
    if not length > 0.0:
        raise InvalidOption("down has no length", hint="Give the direction of gravity.")
    down = below / length
    if isinstance(shape, HalfSpace):
        raise InvalidOption("a half-space can't be grasped")
    surface = surface_of(shape)
    middle = 0.5 * (surface.vertices.min(axis=0) + surface.vertices.max(axis=0))
    drawn = zip(*_points(surface, _DRAWN * search.count, search.seed), strict=True)
    if span is None:
        places = [at for at in drawn if _is_flat(surface, at, search.radius)]
    else:
        pairs = (_between(surface, at, search.friction, span.widest) for at in drawn)
        places = [at for at in pairs if at is not None]
        places = [at for at in places if _approaches(at[1], down, search)]
    places.sort(key=lambda at: float(np.linalg.norm(at[0] - middle)))
    places = places[: search.count]
    # Each place in few ways, so that all of them come among the grasps.
    random, few = np.random.default_rng(search.seed), -(-search.count // max(len(places), 1))
    found: list[Array] = []
    for center, normal in places:
        frames = _cup(normal, search) if span is None else _jaws(normal, down, search, span)
        chosen = (frames[k] for k in random.permutation(len(frames))[:few])
        found += [transform(R, center + search.depth * R[:, 2]) for R in chosen]
    return np.array(found[: search.count]).reshape(-1, 4, 4)


def _between(
    surface: Triangles, at: tuple[Array, Array], friction: float, widest: float
) -> tuple[Array, Array] | None:
    """The middle between a point and its opposite, and the line between them; None if no grasp."""
    point, normal = at
    ways, hit = _hits(surface, point, -normal)
    if not len(ways) or ways.min() < -_SAME:
        return None  # the line leaves the body and enters it again: no finger comes to the point
    last = int(ways.argmax())
    width = float(ways[last])
    steepness = 1.0 / math.sqrt(1.0 + friction**2)
    if not _SAME < width < widest or abs(hit[last] @ normal) < steepness:
        return None
    return point - 0.5 * width * normal, normal


def _jaws(across: Array, down: Array, search: GraspSearch, span: JawSpan) -> list[Array]:
    """Rotations of a tool whose fingers are on a line, shape (3, 3) each."""
    own = np.column_stack([span.axis, np.cross(_Z, span.axis), _Z])
    return [
        np.column_stack([line, np.cross(along, line), along]) @ own.T
        for along in _approaches(across, down, search)
        for line in (across, -across)
    ]


def _approaches(across: Array, down: Array, search: GraspSearch) -> list[Array]:
    """Directions that a tool may come along, perpendicular to the line between its fingers."""
    if search.kind == "antipodal":
        R = align_z(across)
        angles = 2.0 * math.pi * np.arange(search.angles) / search.angles
        return [R @ np.array([math.cos(a), math.sin(a), 0.0]) for a in angles]
    if search.kind == "side":
        level = np.cross(across, down)
        length = float(np.linalg.norm(level))
        return [] if length < _NEAR else [level / length, -level / length]
    along = down - (down @ across) * across
    length = float(np.linalg.norm(along))
    return [] if length < _NEAR else [along / length]


def _is_flat(surface: Triangles, at: tuple[Array, Array], radius: float) -> bool:
    """Whether a surface is flat about a point, as the rim of a cup needs it."""
    point, normal = at
    R = align_z(-normal)
    for angle in 2.0 * math.pi * np.arange(_RIM) / _RIM:
        rim = R @ np.array([math.cos(angle), math.sin(angle), 0.0])
        ways, _ = _hits(surface, point + radius * rim + _ABOVE * normal, -normal)
        ahead = ways[ways > 0.0]
        if not len(ahead) or abs(float(ahead.min()) - _ABOVE) > _FLAT:
            return False
    return True


def _cup(normal: Array, search: GraspSearch) -> list[Array]:
    """Rotations of a cup that sits on a surface, shape (3, 3) each."""
    R = align_z(-normal)
    return [R @ rotation_z(2.0 * math.pi * k / search.angles) for k in range(search.angles)]


def surface_of(shape: Shape) -> Triangles:
    """The surface of a shape in its own frame."""
    if isinstance(shape, Mesh):
        return Triangles(np.asarray(shape.vertices), np.asarray(shape.faces))
    return join(piece_triangles(piece) for piece in shape.pieces())


def _points(surface: Triangles, count: int, seed: int) -> tuple[Array, Array]:
    """Points of a surface and its normals there, away from the body, each of shape (count, 3)."""
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    areas = np.linalg.norm(normals, axis=1)
    random = np.random.default_rng(seed)
    chosen = random.choice(len(areas), count, p=areas / areas.sum())
    u, v = random.random((2, count, 1))
    over = u + v > 1.0
    u, v = np.where(over, 1.0 - u, u), np.where(over, 1.0 - v, v)
    points = a[chosen] + u * (b - a)[chosen] + v * (c - a)[chosen]
    return points, normals[chosen] / areas[chosen, None]


def _hits(surface: Triangles, point: Array, along: Array) -> tuple[Array, Array]:
    """Ways (k,) to where a line meets a surface, behind its start too, and the normals (k, 3).

    By Moeller and Trumbore: p + t d = a + u (b - a) + v (c - a).
    """
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    ab, ac = b - a, c - a
    normals = np.cross(ab, ac)
    slope = -normals @ along
    areas = np.linalg.norm(normals, axis=1)
    crossing = np.abs(slope) > 1e-9 * areas
    ab, ac, a, normals, slope, areas = (
        x[crossing] for x in (ab, ac, a, normals, slope, areas)
    )  # fmt: skip
    ap = point - a
    around = np.cross(ap, along)
    u, v = (ac * around).sum(axis=1) / slope, -(ab * around).sum(axis=1) / slope
    inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9)
    ways = (ap * normals).sum(axis=1) / slope
    return ways[inside], normals[inside] / areas[inside, None]


def object_down(T_root_object: Array) -> Array:
    """Direction of gravity in the frame of an object that stands somewhere, shape (3,)."""
    return np.asarray(inverse(T_root_object)[:3, :3] @ -_Z)
