"""Sides of shoulder, elbow and wrist that a configuration has, and which of them are singular.

``arm_parts`` has the measure of each part and shape of arm. A part is singular where its measure
vanishes: the shoulder of six joints where W lies in the plane of axis 1 that holds axis 2, the
elbow where it and the points it joins are in line, a spherical joint where its outer axes are
parallel. Names of the sides of six joints are those of "A geometric approach in solving the inverse
kinematics of PUMA robots", IEEE Transactions on Aerospace and Electronic Systems, 1984.
"""

from typing import NamedTuple

from numpy.typing import ArrayLike

from kinematics.ik.closed_form.arm_parts import SINGULAR, arm_parts, arm_shape, lines
from kinematics.model.chain import Chain

_PARTS = ("shoulder", "elbow", "wrist")


class ArmSides(NamedTuple):
    """Sides of an arm in one configuration; None where the part is singular, or it has none.

    Args:
        shoulder: "right" where joint 2 raises the wrist centre along axis 1, else "left"; of a
            spherical shoulder "no flip" where the sine of joint 2 is positive, else "flip".
        elbow: "up" where the elbow is above the line from shoulder to wrist, along axis 1, else
            "down"; of a planar arm "left" or "right" of that line, seen against axis 1; of seven
            joints "no flip" where the sine of the bend about axis 4 is positive, else "flip".
        wrist: "no flip" where the sine of its middle joint is positive, else "flip".
        singular: Parts that are singular, of "shoulder", "elbow" and "wrist".
    """

    shoulder: str | None
    elbow: str | None
    wrist: str | None
    singular: tuple[str, ...]


def arm_sides(chain: Chain, q: ArrayLike, link: str | None = None) -> list[ArmSides] | None:
    """Sides of an arm in several configurations; None for arms of another shape.

    Args:
        chain: The robot.
        q: Configurations, shape (m, n) [rad or m].
        link: The link that inverse kinematics is for; the tip where none is named.

    Raises:
        InvalidRobotState: Wrong length or not finite.
        InvalidLinkName: No such link.
    """
    shape = arm_shape(chain, link)
    if shape is None:
        return None
    axes = lines(chain, chain.configuration(q).reshape(-1, chain.n), link)
    parts = arm_parts(shape, axes)
    sides = []
    for i in range(len(axes.z)):
        names: dict[str, str | None] = dict.fromkeys(_PARTS)
        singular = tuple(name for name, part in parts.items() if part.size[i] <= SINGULAR)
        for name, part in parts.items():
            if name not in singular:
                names[name] = part.names[0] if part.side[i] > 0.0 else part.names[1]
        sides.append(ArmSides(names["shoulder"], names["elbow"], names["wrist"], singular))
    return sides
