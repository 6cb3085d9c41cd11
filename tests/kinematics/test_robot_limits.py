"""Limits, inertias and solids of the built-in robots."""

from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from kinematics.arrays import Array
from kinematics.robots import builtin_chain, builtin_srdf, builtin_urdf
from kinematics.tree.description import (
    BoxGeometry,
    CylinderGeometry,
    LinkDescription,
    SphereGeometry,
)
from kinematics.tree.srdf import parse_srdf
from kinematics.urdf.urdf import parse_urdf
from tests.kinematics.builtin import NAMES, configurations, model, pin_configuration


def state(name: str, which: str) -> Array:
    values = parse_srdf(builtin_srdf(name)).states["arm"][which]
    return np.array([values[joint] for joint in builtin_chain(name).joint_names])


DEGREES: dict[str, tuple[list[float], list[float], list[float]]] = {
    "iiwa14": (
        [-170, -120, -170, -120, -170, -120, -175],
        [170, 120, 170, 120, 170, 120, 175],
        [85, 85, 100, 75, 130, 135, 135],
    ),
    "kr6_sixx": (
        [-170, -190, -120, -185, -120, -350],
        [170, 45, 156, 185, 120, 350],
        [360, 300, 360, 381, 388, 615],
    ),
    "ur5e": ([-360, -360, -180, -360, -360, -360], [360, 360, 180, 360, 360, 360], [180] * 6),
    "puma560": (
        [-160, -225, -45, -110, -100, -266],
        [160, 45, 225, 170, 100, 266],
        [82, 54, 122, 228, 241, 228],
    ),
}


@pytest.mark.parametrize("name", DEGREES)
def test_ranges_and_speeds_are_those_published_in_degrees(name: str) -> None:
    limits = builtin_chain(name).limits
    published = np.deg2rad(np.array(DEGREES[name], dtype=float))
    ours = [limits.lower, limits.upper, limits.velocity]
    np.testing.assert_allclose(ours, published, rtol=1e-6)


def test_the_limits_of_the_panda_are_those_published() -> None:
    limits = builtin_chain("panda").limits
    high = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]
    low = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]
    acceleration = [15, 7.5, 10, 12.5, 15, 20, 20]
    np.testing.assert_array_equal(limits.lower, low)
    np.testing.assert_array_equal(limits.upper, high)
    np.testing.assert_array_equal(limits.velocity, [2.175] * 4 + [2.61] * 3)
    np.testing.assert_array_equal(limits.acceleration, acceleration)
    np.testing.assert_array_equal(limits.jerk, 500 * np.array(acceleration))
    np.testing.assert_array_equal(limits.effort, [87.0] * 4 + [12.0] * 3)


@pytest.mark.parametrize("name", NAMES)
def test_every_limit_is_given(name: str) -> None:
    chain = builtin_chain(name)
    for quantity in ("velocity", "acceleration", "jerk", "effort"):
        assert (chain.limits.require(quantity, chain.joint_names) > 0.0).all()
    bounded = ~chain.continuous
    assert np.isfinite(chain.limits.lower[bounded]).all()
    assert np.isfinite(chain.limits.upper[bounded]).all()


#: Mass of the whole robot [kg]: data sheets; the last three are our own.
TOTAL = {
    "panda": 18.0 + 0.73,
    "ur5e": 20.6,
    "iiwa14": 29.9,
    "kr6_sixx": 52.0,
    "puma560": 54.4,
    "scara": 41.0,
    "stanford": 9.29 + 5.01 + 4.25 + 1.08 + 0.63 + 0.51 + 8.0,
    "planar_rr": 1.0 + 1.0 + 5.0,
    "cart_pendulum": 1.0 + 0.2 + 3.0,
    "elbow_wrist": 21.0,
}


@pytest.mark.parametrize("name", NAMES)
def test_every_inertia_belongs_to_a_body(name: str) -> None:
    total = 0.0
    for link in parse_urdf(builtin_urdf(name)).links.values():
        if link.inertia is None:
            continue
        total += link.inertia.mass
        low, middle, high = np.linalg.eigvalsh(link.inertia.tensor)
        assert low > 0.0, link.name
        # Six digits are given: where the bound is reached, rounding may pass it by so much.
        assert high <= (low + middle) * (1 + 1e-5), link.name
    assert total == pytest.approx(TOTAL[name], abs=0.01)


def spread_evenly(link: LinkDescription) -> Any:
    """Pinocchio's inertia of the link's mass spread over its solids by volume."""
    assert link.inertia is not None
    bodies, volumes = [], []
    for element in link.collisions:
        match element.geometry:
            case BoxGeometry(size=(x, y, z)):
                body, volume = pin.Inertia.FromBox(1.0, x, y, z), x * y * z
            case CylinderGeometry(radius=r, length=length):
                body = pin.Inertia.FromCylinder(1.0, r, length)
                volume = np.pi * r * r * length
            case SphereGeometry(radius=r):
                body, volume = pin.Inertia.FromSphere(1.0, r), 4 / 3 * np.pi * r**3
            case other:
                raise AssertionError(other)
        bodies.append((body, pin.SE3(np.array(element.T_link_element))))
        volumes.append(volume)
    whole = pin.Inertia.Zero()
    for (body, placement), volume in zip(bodies, volumes, strict=True):
        mass = link.inertia.mass * volume / sum(volumes)
        whole += placement.act(pin.Inertia(mass, body.lever, body.inertia * mass))
    return whole


ESTIMATED = [
    ("panda", ["panda_link0"]),
    ("ur5e", ["base"]),
    ("iiwa14", [f"iiwa_link_{i}" for i in range(8)]),
    ("kr6_sixx", ["base_link", *(f"link_{i}" for i in range(1, 7))]),
    ("puma560", ["base_link"]),
    ("scara", ["base_link", *(f"link_{i}" for i in range(1, 5))]),
    ("stanford", ["base_link"]),
    ("elbow_wrist", ["base_link", *(f"link_{i}" for i in range(1, 7))]),
]


@pytest.mark.parametrize(("name", "links"), ESTIMATED)
def test_estimated_inertias_are_those_of_the_solids(name: str, links: list[str]) -> None:
    description = parse_urdf(builtin_urdf(name))
    for link in links:
        ours = description.links[link].inertia
        assert ours is not None
        expected = spread_evenly(description.links[link])
        np.testing.assert_allclose(ours.tensor, expected.inertia, rtol=2e-5, atol=1e-8)
        if name != "iiwa14" or link == "iiwa_link_0":  # the others' centres are published
            np.testing.assert_allclose(ours.center_of_mass, expected.lever, atol=1e-5)


class SelfCollision:
    """Pinocchio and Coal on the file's solids, without the SRDF's pairs."""

    def __init__(self, name: str) -> None:
        self.model = model(name)
        text = builtin_urdf(name)
        self.solids = pin.buildGeomFromUrdfString(self.model, text, pin.GeometryType.COLLISION)
        disabled = parse_srdf(builtin_srdf(name)).disabled_collisions
        objects = self.solids.geometryObjects
        for i, one in enumerate(objects):
            for j, other in enumerate(objects[:i]):
                links = [self.model.frames[o.parentFrame].name for o in (one, other)]
                rigid = one.parentJoint == other.parentJoint
                if not rigid and tuple(sorted(links)) not in disabled:
                    self.solids.addCollisionPair(pin.CollisionPair(j, i))
        self.data, self.found = self.model.createData(), self.solids.createData()

    def __call__(self, q: Array) -> bool:
        found = pin.computeCollisions(self.model, self.data, self.solids, self.found, q, True)
        return bool(found)


@pytest.mark.parametrize("name", NAMES)
def test_named_states_are_within_limits_and_free(name: str) -> None:
    chain, collides = builtin_chain(name), SelfCollision(name)
    states = parse_srdf(builtin_srdf(name)).states["arm"]
    assert "home" in states
    for which in states:
        q = state(name, which)
        assert (q >= chain.limits.lower).all()
        assert (q <= chain.limits.upper).all()
        assert not collides(pin_configuration(chain, q)), which


#: Share of 2,000 random configurations that is free (see docs/robots.md), less about 5 %.
FREE = {
    "panda": 0.74,
    "ur5e": 0.74,
    "iiwa14": 0.94,
    "kr6_sixx": 0.91,
    "puma560": 0.94,
    "scara": 0.95,
    "stanford": 0.90,
    "planar_rr": 1.0,
    "cart_pendulum": 1.0,
    "elbow_wrist": 0.91,
}


@pytest.mark.parametrize("name", NAMES)
def test_most_random_configurations_are_free(name: str) -> None:
    chain, collides = builtin_chain(name), SelfCollision(name)
    samples = configurations(chain, 400)
    free = sum(not collides(pin_configuration(chain, q)) for q in samples)
    assert free / len(samples) >= FREE[name] >= 0.6


@pytest.mark.parametrize("name", NAMES)
def test_only_neighbours_are_allowed_to_touch(name: str) -> None:
    description = parse_urdf(builtin_urdf(name))
    solid = [link for link, item in description.links.items() if item.collisions]
    neighbours = {tuple(sorted(pair)) for pair in pairwise(solid)}
    assert parse_srdf(builtin_srdf(name)).disabled_collisions == neighbours
