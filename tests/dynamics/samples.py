"""Random and textbook chains with inertias, and the same chains as pinocchio models."""

from typing import Any

import numpy as np
import pinocchio as pin

from kinematics.arrays import Array
from kinematics.model.chain import Chain, Inertia, JointType, Limits, Link
from kinematics.pose import from_axis_angle, from_rpy, transform

REVOLUTE, PRISMATIC = int(JointType.REVOLUTE), int(JointType.PRISMATIC)


def random_transform(rng: np.random.Generator, reach: float) -> Array:
    return transform(from_rpy(rng.uniform(-3, 3, 3)), rng.uniform(-reach, reach, 3))


def random_inertia(rng: np.random.Generator) -> Inertia:
    """Of six random point masses, so that it is physical."""
    masses = rng.uniform(0.05, 1.0, 6)
    points = rng.uniform(-0.2, 0.2, (6, 3)) + rng.uniform(-0.3, 0.3, 3)
    center = masses @ points / masses.sum()
    d = points - center
    tensor = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, d, strict=True))
    return Inertia(float(masses.sum()), center, np.asarray(tensor))


def random_chain(seed: int, n: int = 6, *, motors: bool = False) -> Chain:
    """Joints of both types; joint 0 carries two bodies, joint n-1 a mere tool frame too."""
    rng = np.random.default_rng(seed)
    links = [Link("base", -1, np.eye(4), random_inertia(rng))]
    links += [
        Link(f"link{i}", i, random_transform(rng, 0.2), random_inertia(rng)) for i in range(n)
    ]
    links.append(Link("rider", 0, random_transform(rng, 0.3), random_inertia(rng)))
    links.append(Link("tool", n - 1, random_transform(rng, 0.3)))
    return Chain(
        name=f"random{seed}",
        joint_names=tuple(f"joint{i}" for i in range(n)),
        joint_types=rng.integers(0, 2, n),
        offsets=np.array([random_transform(rng, 0.5) for _ in range(n)]),
        links=tuple(links),
        base_link="base",
        tip_link="tool",
        limits=Limits.unlimited(n),
        continuous=np.zeros(n, dtype=np.bool_),
        gravity=rng.uniform(-10, 10, 3),
        motor_inertia=rng.uniform(0.0, 0.5, n) if motors else np.zeros(n),
        viscous_friction=rng.uniform(0.0, 2.0, n) if motors else np.zeros(n),
    )


def random_state(chain: Chain, seed: int, count: int = 20) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    q, qd, qdd = rng.uniform(-3, 3, (3, count, chain.n))
    return q, qd, qdd


def planar_rr(
    masses: tuple[float, float] = (2.0, 1.5),
    lengths: tuple[float, float] = (0.7, 0.5),
    centers: tuple[float, float] = (0.3, 0.2),
    inertias: tuple[float, float] = (0.05, 0.02),
) -> Chain:
    """The notes' planar arm, gravity along -y; its centres lie on the links."""
    offsets = np.array([np.eye(4), transform(position=[lengths[0], 0, 0])])
    links = [
        Link(
            f"link{i}",
            i,
            np.eye(4),
            Inertia(masses[i], np.array([centers[i], 0, 0]), np.diag([0.1, 0.1, inertias[i]])),
        )
        for i in range(2)
    ]
    links.append(Link("tip", 1, transform(position=[lengths[1], 0, 0])))
    return textbook("planar_rr", [REVOLUTE, REVOLUTE], offsets, links, [0.0, -9.81, 0.0])


def cart_pendulum(
    cart: float = 1.3, mass: float = 0.4, length: float = 0.6, inertia: float = 0.03
) -> Chain:
    """The notes' cart along z_0 with x_0 upwards: DH alpha_1 = -pi/2, phi from the upright."""
    turn = transform(from_axis_angle([1.0, 0.0, 0.0], -np.pi / 2))
    offsets = np.array([np.eye(4), turn])
    links = [
        Link("cart", 0, np.eye(4), Inertia(cart, np.zeros(3), np.eye(3))),
        Link(
            "pendulum",
            1,
            np.eye(4),
            Inertia(mass, np.array([length, 0, 0]), np.diag([0.5, 0.7, inertia])),
        ),
    ]
    return textbook("cart_pendulum", [PRISMATIC, REVOLUTE], offsets, links, [-9.81, 0.0, 0.0])


def textbook(
    name: str, types: list[int], offsets: Array, links: list[Link], gravity: list[float]
) -> Chain:
    n = len(types)
    return Chain(
        name=name,
        joint_names=tuple(f"q{i + 1}" for i in range(n)),
        joint_types=np.array(types),
        offsets=offsets,
        links=tuple(links),
        base_link="base",
        tip_link=links[-1].name,
        limits=Limits.unlimited(n),
        continuous=np.zeros(n, dtype=np.bool_),
        gravity=np.array(gravity),
    )


def pinocchio_model(chain: Chain) -> Any:
    """The same bodies hung on pinocchio's own joints, link by link."""
    model = pin.Model()
    model.gravity.linear = np.array(chain.gravity)
    parent = 0
    for i, name in enumerate(chain.joint_names):
        joint = pin.JointModelRZ() if chain.joint_types[i] == REVOLUTE else pin.JointModelPZ()
        parent = model.addJoint(parent, joint, pin.SE3(np.array(chain.offsets[i])), name)
    for link in chain.links:
        if link.joint >= 0 and link.inertia is not None:
            body = pin.Inertia(
                link.inertia.mass,
                np.array(link.inertia.center_of_mass),
                np.array(link.inertia.tensor),
            )
            placement = pin.SE3(np.array(link.T_joint_link))
            model.appendBodyToJoint(link.joint + 1, body, placement)
    model.armature = np.array(chain.motor_inertia)
    return model


def random_urdf(seed: int, *, branch: bool = False) -> str:
    """An arm as people upload it: skew axes, turned inertias, links bolted on, perhaps a branch."""
    rng = np.random.default_rng(seed)

    def triple(values: Array) -> str:
        return " ".join(f"{value:.9f}" for value in values)

    def origin() -> str:
        xyz, rpy = rng.uniform(-0.4, 0.4, 3), rng.uniform(-3, 3, 3)
        return f'<origin xyz="{triple(xyz)}" rpy="{triple(rpy)}"/>'

    def link(name: str) -> str:
        body = random_inertia(rng)
        I = body.tensor  # noqa: E741
        entries = {
            "ixx": I[0, 0], "ixy": I[0, 1], "ixz": I[0, 2],
            "iyy": I[1, 1], "iyz": I[1, 2], "izz": I[2, 2],
        }  # fmt: skip
        values = " ".join(f'{key}="{value:.12f}"' for key, value in entries.items())
        return (
            f'<link name="{name}"><inertial>{origin()}<mass value="{body.mass:.9f}"/>'
            f"<inertia {values}/></inertial></link>"
        )

    def joint(name: str, kind: str, parent: str, child: str) -> str:
        axis = "" if kind == "fixed" else f'<axis xyz="{triple(rng.normal(size=3))}"/>'
        limit = "" if kind == "fixed" else '<limit lower="-3" upper="3" velocity="1" effort="9"/>'
        return (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f"{origin()}{axis}{limit}</joint>"
        )

    parts, last = [link("base")], "base"
    for i in range(3 + seed % 5):
        kind = "prismatic" if rng.uniform() < 0.3 else "revolute"
        parts += [link(f"link{i}"), joint(f"joint{i}", kind, last, f"link{i}")]
        parts += [link(f"plate{i}"), joint(f"bolt{i}", "fixed", f"link{i}", f"plate{i}")]
        last = f"plate{i}"
    if branch:
        parts += [link("finger"), joint("side", "revolute", "plate1", "finger")]
        parts += [link("nail"), joint("slide", "prismatic", "finger", "nail")]
    return f'<robot name="upload{seed}">{"".join(parts)}</robot>'


def relative_error(value: Array, reference: Array) -> float:
    """Largest difference over the largest entry of the reference."""
    scale = float(np.abs(reference).max())
    return float(np.abs(value - reference).max()) / (scale if scale > 0.0 else 1.0)
