"""The arms of the course notes as Denavit-Hartenberg tables, with the lengths that tests use."""

from math import pi
from typing import Any

Table = dict[str, Any]

#: Lengths of the two-link arm of lecture 9 [m].
A1, A2 = 0.6, 0.4
#: Lengths of the RRP arm with an elbow of lecture 9 [m].
ELBOW_A1, ELBOW_D1, ELBOW_D2 = 0.2, 0.5, 0.3
#: Lengths of the articulated RRR arm of lectures 15 and 17 [m].
RRR_D1, RRR_A2, RRR_A3 = 0.4, 0.5, 0.35
#: Masses [kg], lengths [m] and moments of inertia [kg m²] of the planar arm of lecture 27.
M1, M2, L1, LC1, LC2, I1, I2 = 2.0, 1.5, 0.7, 0.3, 0.25, 0.09, 0.05
#: Cart, pendulum, distance of its centre of mass and inertia of lecture 26.
CART, BOB, ROD, I_BOB = 1.3, 0.4, 0.6, 0.02


def revolute(a: float = 0.0, alpha: float = 0.0, d: float = 0.0, **more: Any) -> Table:
    """A row of a revolute joint [m, rad]."""
    limits = {"lower": -6.3, "upper": 6.3, "velocity": 4.0, "acceleration": 30.0, "jerk": 900.0}
    return {"type": "revolute", "a": a, "alpha": alpha, "d": d, "theta": 0.0} | limits | more


def prismatic(a: float = 0.0, alpha: float = 0.0, **more: Any) -> Table:
    """A row of a prismatic joint [m, rad]."""
    limits = {"lower": -5.0, "upper": 5.0, "velocity": 4.0, "acceleration": 30.0, "jerk": 900.0}
    return {"type": "prismatic", "a": a, "alpha": alpha, "d": 0.0, "theta": 0.0} | limits | more


def body(mass: float, center: list[float], inertia_zz: float) -> Table:
    """Mass properties of a link whose inertia matters about its z axis only."""
    inertia = [[inertia_zz, 0.0, 0.0], [0.0, inertia_zz, 0.0], [0.0, 0.0, inertia_zz]]
    return {"mass": mass, "center_of_mass": center, "inertia": inertia}


def _robot(name: str, *rows: Table, **more: Any) -> Table:
    return {"name": name, "dh": {"convention": "standard", "rows": list(rows), **more}}


_CART = _robot(
    "notes_cart",
    prismatic(alpha=-pi / 2.0, **body(CART, [0.0, 0.0, 0.0], 0.01)),
    revolute(ROD, **body(BOB, [0.0, 0.0, 0.0], I_BOB)),
    gravity=[-9.81, 0.0, 0.0],
)
_ELBOW = _robot(
    "notes_elbow",
    revolute(ELBOW_A1, -pi / 2.0, ELBOW_D1),
    revolute(0.0, pi / 2.0, ELBOW_D2),
    prismatic(),
)

#: Everything that the tests of the course store.
ROBOTS = [
    _robot("notes_two_link", revolute(A1), revolute(A2)),
    _ELBOW,
    _robot("notes_rrr", revolute(0.0, pi / 2.0, RRR_D1), revolute(RRR_A2), revolute(RRR_A3)),
    # Lecture 27; the rows reach from the tip of each link back to the centre.
    _robot(
        "notes_planar",
        revolute(L1, **body(M1, [LC1 - L1, 0.0, 0.0], I1)),
        revolute(0.5, **body(M2, [LC2 - 0.5, 0.0, 0.0], I2)),
        gravity=[0.0, -9.81, 0.0],
    ),
    _CART,
]
