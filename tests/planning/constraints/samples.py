"""Constraints of every kind that the tests of this folder share."""

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.pose import transform
from planning.constraints.kinds.constraint import (
    BoxRegion,
    ConeConstraint,
    Geometric,
    JointConstraint,
    LineRegion,
    LookAtConstraint,
    OrientationConstraint,
    PlaneRegion,
    PositionConstraint,
    RelativePoseConstraint,
    SphereRegion,
)
from tests.kinematics.samples import random_rotation


def some_of_each(chain: Chain, seed: int) -> list[Geometric]:
    """Every kind, for the tip and for another link, seen from the base and from a link."""
    rng = np.random.default_rng(seed)
    moving = [link for link in chain.links if link.joint >= 0]

    def vector() -> Array:
        return rng.normal(size=3) * 0.4

    def places() -> list[tuple[str | None, str | None]]:
        answer: list[tuple[str | None, str | None]] = [(None, None)]
        for _ in range(2):
            i, j = rng.integers(len(moving), size=2)
            if moving[i].joint != moving[j].joint:
                answer.append((moving[i].name, moving[j].name))
        return answer

    made: list[Geometric] = [
        JointConstraint(chain.joint_names[-1], 0.3, 0.1, 0.2),
        JointConstraint(chain.joint_names[0], -0.3, 0.5, 0.0, weight=2.0),
    ]
    for link, seen_from in places():
        T = transform(random_rotation(rng), vector())
        regions = (
            BoxRegion(T, rng.uniform(0.1, 0.5, 3)),
            BoxRegion(T, np.array([0.1, np.inf, 0.2])),
            SphereRegion(vector(), 0.2),
            PlaneRegion(vector(), vector(), 0.01),
            LineRegion(vector(), vector(), 0.02, 0.3),
            LineRegion(vector(), vector(), 0.02),
        )
        made += [PositionConstraint(region, link, vector(), seen_from) for region in regions]
        made += [
            ConeConstraint(vector(), vector(), 0.2, link, seen_from),
            OrientationConstraint(
                random_rotation(rng), rng.uniform(0.1, 1.0, 3), link, seen_from, weight=1.0
            ),
            OrientationConstraint(random_rotation(rng), [0.1, 0.1, np.pi], link, seen_from),
            LookAtConstraint(vector(), vector() * 3.0, 0.2, link, vector(), seen_from),
            RelativePoseConstraint(T, link, seen_from, 0.1, [0.1, 0.2, 4.0]),
        ]
    return made
