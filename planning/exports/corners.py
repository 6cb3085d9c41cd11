"""Corners that a controller cuts: how far, so that nothing collides whatever curve it takes.

Makers do not publish the curve. Taken for granted is that it stays in the triangle, in joint
space, of the points where it leaves the one leg and meets the other, and of the corner between.
The triangle is cut into strips across the corner. The middle line of each strip is proved free
with a distance to spare that covers the strip: with R_k the farthest that a point carried by joint
k can be from its axis, no point of the arm is farther than sum_k R_k |q_k - p_k| from where it is
at p.
"""

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.forward import forward
from kinematics.model.chain import Chain
from obstacles.collision.checker import Checker
from obstacles.robots.allowed_pairs import allowed_pairs
from obstacles.robots.robot_geometry import RobotGeometry, lever_arms, link_arms
from obstacles.scenes.scene import Scene

#: Share of a leg that one corner may take, less than half for corners to stay apart.
_MOST = 0.45
#: Strips of one triangle at most.
_STRIPS = 200
#: Points of a leg at which the flange is placed, and the least radius that is written [m].
_SAMPLES, _LEAST = 64, 1e-4
#: The flange, in whose frame controllers have the tool that programs here name.
_FLANGE = "tool0"


def blend_link(chain: Chain) -> str:
    """The link whose origin radii are about: the flange, or the tip where no link is called so."""
    return _FLANGE if _FLANGE in chain.index else chain.tip_link


def check_flange(chain: Chain) -> None:
    """Refuse radii of a robot of which nothing says where controllers have the flange.

    Raises:
        InvalidOption: It has no link of that name.
    """
    if _FLANGE not in chain.index:
        raise InvalidOption(
            f"blend: radii are about the flange, and robot {chain.name!r} has no link {_FLANGE!r}",
            hint=f"Call the frame of its flange {_FLANGE!r}, leave blend out, or choose krl.",
        )


def fitted_corners(
    points: Array, robot: RobotGeometry, scene: Scene, margin: float, blend: float
) -> tuple[Array, Array]:
    """How far each point of a path may be cut.

    Args:
        points: Points with straight legs between them, shape (p, n) [rad or m].
        robot: The arm with its geometry; what it holds is part of it.
        scene: The obstacles.
        margin: Distance to keep from obstacles beyond their own margins [m].
        blend: Largest distance of the flange from a point at which a controller leaves the leg [m].

    Returns:
        Shares of the legs beside each point, and radii [m] that hold no more of either leg, each
        of shape (p,); 0 where the arm stops.
    """
    shares, radii = np.zeros(len(points)), np.zeros(len(points))
    if any(pair.limited for pair in allowed_pairs(robot, scene)):
        return shares, radii  # what touches may go in no deeper
    checker, chain = Checker.of(robot, scene, margin), robot.chain
    legs = np.abs(np.diff(points, axis=0))
    sizes, ways = legs @ lever_arms(robot), legs @ link_arms(chain, blend_link(chain))
    for k in range(1, len(points) - 1):
        size, way = sizes[k - 1 : k + 1].max(), ways[k - 1 : k + 1].max()
        if not (0.0 < size < np.inf and 0.0 < way < np.inf):
            continue
        ends = points[[k - 1, k + 1]]
        # No more of a leg than the blend that is asked for takes, as far as is known before.
        share = min(_MOST, max(_share_of(chain, points[k], end, blend) for end in ends))
        share = _free_share(checker, points[k], ends, size, share)
        if not share:
            continue
        sides = [_flange_leaves(chain, points[k], end, share, way) for end in ends]
        radius = np.floor(1e5 * min(blend, *sides)) / 1e5
        if radius >= _LEAST:
            shares[k], radii[k] = min(share, blend / way), radius
    return shares, radii


def _free_share(checker: Checker, corner: Array, ends: Array, size: float, share: float) -> float:
    """The share of the legs of a corner whose triangle is proved free, at most a given one.

    Args:
        checker: The robot in its surroundings.
        corner: The corner, shape (n,).
        ends: Other ends of its legs, shape (2, n).
        size: Way of any point of the arm along the longer leg, at most [m].
        share: Share that is tried first.
    """
    clearance = checker.clearance(corner)[0]
    while clearance > 0.0 and share * size > _LEAST:
        # Strips so narrow that their lines have half of the clearance at the corner to spare.
        strips = max(int(np.ceil(share * size / clearance)), 1)
        if strips <= _STRIPS:
            lines = Checker(checker.model, 0.5 * share * size / strips)
            middles = share * (np.arange(strips) + 0.5) / strips
            if all(lines.free(*(corner + t * (ends - corner))) for t in middles[::-1]):
                return share
        share *= 0.7
    return 0.0


def _share_of(chain: Chain, corner: Array, end: Array, blend: float) -> float:
    """Share of a leg after which the flange is farther from the corner than a blend."""
    at = np.linspace(0.0, 1.0, _SAMPLES + 1)
    link = blend_link(chain)
    there = forward(chain, corner + at[:, None] * (end - corner), link)[:, :3, 3]
    near = np.linalg.norm(there - there[0], axis=1) <= blend
    return float(at[min(np.flatnonzero(near)[-1] + 2, _SAMPLES)])


def _flange_leaves(chain: Chain, corner: Array, end: Array, share: float, way: float) -> float:
    """A radius about the flange at a corner that a leg leaves before a share of it, for good [m].

    Between points at which the flange is placed it comes nearer by half of their distance at most.
    """
    at = np.linspace(share, 1.0, _SAMPLES + 1)[:, None]
    link = blend_link(chain)
    there = forward(chain, corner + at * (end - corner), link)[:, :3, 3]
    away = np.linalg.norm(there - forward(chain, corner, link)[:3, 3], axis=1)
    nearest = float(away.min()) - 0.5 * way * (1.0 - share) / _SAMPLES
    # Two radii of one leg have to fit into its chord.
    return min(nearest, _MOST * float(away[-1]))
