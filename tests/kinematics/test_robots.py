"""The built-in robots against published tables, closed forms and Pinocchio."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.forward import forward, joint_frames
from kinematics.pose import transform
from kinematics.robots import builtin_chain, builtin_srdf, builtin_urdf
from kinematics.tree.srdf import parse_srdf
from kinematics.urdf.urdf import parse_urdf
from tests.kinematics.builtin import NAMES, configurations, model, pin_configuration

H = np.pi / 2


#: Rows (a, alpha, d, theta); for the prismatic joint of an arm d is added to the joint value.
Table = Sequence[tuple[float, float, float, float]]


MODIFIED: dict[str, Table] = {
    # "Franka Control Interface documentation", Denavit-Hartenberg parameters.
    "panda": (
        (0, 0, 0.333, 0),
        (0, -H, 0, 0),
        (0, H, 0.316, 0),
        (0.0825, H, 0, 0),
        (-0.0825, -H, 0.384, 0),
        (0, H, 0, 0),
        (0.088, H, 0, 0),
    ),
    # Dimensions 360, 420, 400, 126 mm of the LBR iiwa 14 R820 with the basic flange.
    "iiwa14": (
        (0, 0, 0.36, 0),
        (0, -H, 0, 0),
        (0, H, 0.42, 0),
        (0, H, 0, 0),
        (0, -H, 0.4, 0),
        (0, -H, 0, 0),
        (0, H, 0.126, 0),
    ),
    # "The explicit dynamic model and inertial parameters of the PUMA 560 arm".
    "puma560": (
        (0, 0, 0, 0),
        (0, -H, 0.2435, 0),
        (0.4318, 0, -0.0934, 0),
        (-0.0203, H, 0.4331, 0),
        (0, -H, 0, 0),
        (0, H, 0, 0),
    ),
}


STANDARD: dict[str, Table] = {
    # "DH parameters for calculations of kinematics and dynamics", UR5e.
    "ur5e": (
        (0, H, 0.1625, 0),
        (-0.425, 0, 0, 0),
        (-0.3922, 0, 0, 0),
        (0, H, 0.1333, 0),
        (0, -H, 0.0997, 0),
        (0, 0, 0.0996, 0),
    ),
    # "Modeling, trajectory calculation and servoing of a computer controlled arm".
    "stanford": (
        (0, -H, 0.412, 0),
        (0, H, 0.154, 0),
        (0, 0, 0, -H),
        (0, -H, 0, 0),
        (0, H, 0, 0),
        (0, 0, 0.263, 0),
    ),
    # The Cobra 600.
    "scara": ((0.325, 0, 0.387, 0), (0.275, np.pi, 0, 0), (0, 0, 0, 0), (0, 0, 0, 0)),
    # Lecture 11's elbow manipulator with d1 = a2 = d4 = 0.4 m, d6 = 0.1 m.
    "elbow_wrist": (
        (0, H, 0.4, 0),
        (0.4, 0, 0, 0),
        (0, H, 0, 0),
        (0, -H, 0.4, 0),
        (0, H, 0, 0),
        (0, 0, 0.1, 0),
    ),
    # Lecture 26, in a base frame with x up and z along the track.
    "cart_pendulum": ((0, -H, 0, 0), (0.5, 0, 0, 0)),
    "planar_rr": ((1, 0, 0, 0), (1, 0, 0, 0)),
}


def rotation(axis: str, angle: float) -> Array:
    return transform(Rotation.from_euler(axis, angle).as_matrix())


def shift(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    return transform(None, [x, y, z])


#: Frame 0 of the table in the robot's base frame, and the tip in the table's last frame.
BASE = {
    "puma560": shift(z=0.6718),
    "cart_pendulum": np.array([[0, 0, 1, 0], [0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]]),
    "planar_rr": rotation("x", H),
}


TIP = {
    "panda": shift(z=0.107) @ rotation("z", -np.pi / 4) @ shift(z=0.1034),
    "puma560": shift(z=0.05625),
}


def tip_from_table(name: str, q: Array, prismatic: Sequence[bool]) -> Array:
    T = BASE.get(name, np.eye(4))
    modified = name in MODIFIED
    table = (MODIFIED if modified else STANDARD)[name]
    for (a, alpha, d, theta), value, slides in zip(table, q, prismatic, strict=True):
        along_x = rotation("x", alpha) @ shift(x=a)
        turn, lift = (theta, d + value) if slides else (theta + value, d)
        along_z = rotation("z", turn) @ shift(z=lift)
        T = T @ (along_x @ along_z if modified else along_z @ along_x)
    return T @ TIP.get(name, np.eye(4))


def kr6_tip(q: Array) -> Array:
    """Turns about lines of the dimension drawing, arm stretched out level at 0."""
    lines = (
        ("z", -1, (0, 0, 0)),
        ("y", 1, (0.025, 0, 0.4)),
        ("y", 1, (0.48, 0, 0.4)),
        ("x", -1, (0, 0, 0.435)),
        ("y", 1, (0.9, 0, 0.435)),
        ("x", -1, (0, 0, 0.435)),
    )
    T = np.eye(4)
    for (axis, sign, (x, y, z)), angle in zip(lines, q, strict=True):
        T = T @ shift(x, y, z) @ rotation(axis, sign * angle) @ shift(-x, -y, -z)
    return T @ shift(0.98, 0, 0.435) @ rotation("y", H)


@pytest.mark.parametrize("read", [builtin_urdf, builtin_srdf, builtin_chain])
def test_an_unknown_name_is_refused_with_the_choices(read: Any) -> None:
    with pytest.raises(InvalidOption) as caught:
        read("../panda")
    assert all(name in (caught.value.hint or "") for name in NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_the_description_is_one_clean_chain(name: str) -> None:
    description = parse_urdf(builtin_urdf(name))
    assert description.name == name
    assert all(len(description.children(link)) <= 1 for link in description.links)
    # Only pure frames have no solids.
    frames = {link for link, item in description.links.items() if item.inertia is None}
    assert len(description.lint) == len([t for t in description.lint if "no collision" in t])
    assert {t.split("'")[1] for t in description.lint} <= frames
    assert all(item.collisions for link, item in description.links.items() if link not in frames)


@pytest.mark.parametrize("name", [n for n in NAMES if n != "kr6_sixx"])
def test_the_tip_is_where_the_published_table_has_it(name: str) -> None:
    chain = builtin_chain(name)
    for q in configurations(chain, 20):
        expected = tip_from_table(name, q, [bool(t) for t in chain.joint_types])
        np.testing.assert_allclose(forward(chain, q), expected, atol=1e-12)


def test_the_tip_of_the_kr6_is_where_its_drawing_has_it() -> None:
    chain = builtin_chain("kr6_sixx")
    for q in configurations(chain, 20):
        np.testing.assert_allclose(forward(chain, q), kr6_tip(q), atol=1e-12)


def test_the_planar_arm_has_the_closed_forms_of_lecture_27() -> None:
    chain, theirs = builtin_chain("planar_rr"), model("planar_rr")
    data = theirs.createData()
    for q1, q2 in configurations(chain, 20):
        d12, d22 = 0.25 + 0.5 * np.cos(q2) + 1 / 12, 0.25 + 1 / 12
        d11 = 0.25 + 1.25 + np.cos(q2) + 2 / 12
        D = pin.crba(theirs, data, np.array([q1, q2]))
        # The file gives the moments of inertia to six digits.
        np.testing.assert_allclose(np.triu(D), [[d11, d12], [0, d22]], atol=1e-6)
        G = pin.computeGeneralizedGravity(theirs, data, np.array([q1, q2]))
        second = 0.5 * 9.81 * np.cos(q1 + q2)
        np.testing.assert_allclose(G, [1.5 * 9.81 * np.cos(q1) + second, second], atol=1e-12)


def test_the_cart_pendulum_has_the_closed_forms_of_lecture_26() -> None:
    chain, theirs = builtin_chain("cart_pendulum"), model("cart_pendulum")
    data = theirs.createData()
    for x, phi in configurations(chain, 20):
        q = pin_configuration(chain, np.array([x, phi]))
        D = pin.crba(theirs, data, q)
        d12, d22 = -0.2 * 0.5 * np.cos(phi), 0.4 * 0.2 * 0.03**2 + 0.2 * 0.25
        np.testing.assert_allclose(np.triu(D), [[1.2, d12], [0, d22]], atol=1e-14)
        G = pin.computeGeneralizedGravity(theirs, data, q)
        # With the sine that follows from the potential energy m2 g l cos(phi).
        np.testing.assert_allclose(G, [0, -0.2 * 0.5 * 9.81 * np.sin(phi)], atol=1e-14)
    np.testing.assert_allclose(forward(chain, [0, 0])[:3, 3], [0, 0, 0.5], atol=1e-14)


def test_the_puma_holds_itself_as_its_published_gravity_terms_say() -> None:
    """g1 = -37.2, g2 = -8.44, g4 = 0.249 N m of the explicit dynamic model."""
    theirs = model("puma560")
    data = theirs.createData()
    upright = pin.computeGeneralizedGravity(theirs, data, np.zeros(6))
    level = pin.computeGeneralizedGravity(theirs, data, np.array([0, 0, H, 0, 0, 0]))
    assert abs(upright[1]) == pytest.approx(37.2 - 0.249, abs=0.05)
    assert abs(level[2]) == pytest.approx(8.44, abs=0.05)
    assert abs(level[1]) == pytest.approx(37.2 + 8.44, abs=0.1)


def test_the_reach_is_the_published_one() -> None:
    for name, q, joint, reach in (
        ("kr6_sixx", [0, 0, np.arctan2(0.035, 0.42), 0, 0, 0], 4, 0.9015),
        ("iiwa14", [0, H, 0, 0, 0, 0, 0], 5, 0.820),
    ):
        wrist = joint_frames(builtin_chain(name), q)[joint, :3, 3]
        assert wrist[0] == pytest.approx(reach, abs=1e-3), name


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
