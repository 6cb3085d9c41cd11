"""Robots with a load at a link, motors at the joints, or another direction of gravity."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, numbers
from kinematics.errors import InvalidLinkName, InvalidOption
from kinematics.model.chain import Chain, Inertia, Link
from kinematics.rounding import asymmetry, moment_rounding, tensor_rounding


def with_payload(
    chain: Chain,
    mass: float,
    center_of_mass: ArrayLike = (0.0, 0.0, 0.0),
    tensor: ArrayLike | None = None,
    *,
    link: str | None = None,
) -> Chain:
    """Robot with a rigid load fixed to a link.

    Args:
        chain: The robot.
        mass: [kg].
        center_of_mass: Centre of mass in the link's frame, shape (3,) [m].
        tensor: Inertia about the centre of mass, in the link's axes, shape (3, 3) [kg m^2]; a point
            mass where none is given.
        link: Link that carries the load; the tip where none is named.

    Raises:
        InvalidLinkName: No such link.
        InvalidOption: The mass is not positive, or the tensor is not one of a body.
    """
    carrier = chain.link(link or chain.tip_link)
    body = inertia(mass, center_of_mass, np.zeros((3, 3)) if tensor is None else tensor)
    name = next(
        candidate
        for candidate in ("payload", *(f"payload_{i}" for i in range(2, len(chain.links) + 3)))
        if candidate not in chain.index
    )
    load = Link(name, carrier.joint, carrier.T_joint_link, body)
    return replace(chain, links=(*chain.links, load))


def with_inertias(chain: Chain, inertias: Mapping[str, Inertia]) -> Chain:
    """Robot with the mass properties of some links replaced, by the links' names.

    Raises:
        InvalidLinkName: A link is unknown.
    """
    for name in inertias:
        chain.link(name)
    links = tuple(replace(k, inertia=inertias.get(k.name, k.inertia)) for k in chain.links)
    return replace(chain, links=links)


@dataclass(frozen=True, slots=True, eq=False)
class IdentifiedBodies:
    """Bodies and drives of a robot as they were found, in place of those of its description.

    Args:
        links: Body of all that moves with a joint, by a link that moves with it, in its frame.
        motor_inertia: J reflected at the joints, shape (n,) [kg m^2 or kg]; as before where None.
        viscous_friction: B, shape (n,) [N m s/rad or N s/m]; likewise.
        coulomb_friction: F, shape (n,) [N m or N]; likewise.
    """

    links: Mapping[str, Inertia]
    motor_inertia: ArrayLike | None = None
    viscous_friction: ArrayLike | None = None
    coulomb_friction: ArrayLike | None = None

    @classmethod
    def of(cls, chain: Chain, bodies: Sequence[Inertia]) -> "IdentifiedBodies":
        """Bodies in the frames of the joints, each told in the frame of the first link there."""
        links = {}
        for joint, body in enumerate(bodies):
            link = next(link for link in chain.links if link.joint == joint)
            R, p = link.T_joint_link[:3, :3], link.T_joint_link[:3, 3]
            center = R.T @ (body.center_of_mass - p)
            links[link.name] = Inertia(body.mass, center, R.T @ body.tensor @ R)
        return cls(links)


def with_bodies(chain: Chain, found: IdentifiedBodies) -> Chain:
    """Robot with other bodies and drives.

    Raises:
        InvalidLinkName: A link is unknown, stands still, or two move with one joint.
        InvalidOption: A drive's value is negative or their number is wrong.
    """
    moved = [chain.link(name).joint for name in found.links]
    for name, joint in zip(found.links, moved, strict=True):
        if not 0 <= joint < chain.n or moved.count(joint) > 1:
            raise InvalidLinkName(
                f"link {name!r} stands still, or moves with another link that a body is given for",
                hint="Give one body for each joint, that of all that moves with it.",
                link=name,
            )
    links = tuple(
        replace(link, inertia=found.links.get(link.name)) if link.joint in moved else link
        for link in chain.links
    )
    drives = (found.motor_inertia, found.viscous_friction, found.coulomb_friction)
    return with_motors(replace(chain, links=links), *drives)


def with_motors(
    chain: Chain,
    inertia: ArrayLike | None = None,
    viscous_friction: ArrayLike | None = None,
    coulomb_friction: ArrayLike | None = None,
) -> Chain:
    """Robot with other motors: M = D + J, B q_dot and dry friction F tanh(q_dot / v).

    Args:
        chain: The robot.
        inertia: J reflected at the joints (rotor inertia times gear ratio squared), one number or
            shape (n,) [kg m^2 or kg]; as before where none is given.
        viscous_friction: B, one number or shape (n,) [N m s/rad or N s/m]; likewise.
        coulomb_friction: F, one number or shape (n,) [N m or N]; likewise.

    Raises:
        InvalidOption: A value is negative or not finite, or their number is wrong.
    """
    J = chain.motor_inertia if inertia is None else _not_negative(chain, "inertia", inertia)
    B = chain.viscous_friction
    if viscous_friction is not None:
        B = _not_negative(chain, "viscous_friction", viscous_friction)
    F = chain.coulomb_friction
    if coulomb_friction is not None:
        F = _not_negative(chain, "coulomb_friction", coulomb_friction)
    return replace(chain, motor_inertia=J, viscous_friction=B, coulomb_friction=F)


def with_gravity(chain: Chain, gravity: ArrayLike) -> Chain:
    """Robot mounted otherwise: gravity (3,) [m/s^2] in its base frame.

    Raises:
        InvalidOption: The vector is not three finite numbers.
    """
    return replace(chain, gravity=numbers(gravity, "gravity in the base frame", (3,)))


def inertia(mass: float, center_of_mass: ArrayLike, tensor: ArrayLike) -> Inertia:
    """Mass properties, checked to be those of some body.

    Raises:
        InvalidOption: The mass is not positive, a value is not finite, or the tensor is not
            symmetric, not positive semidefinite or breaks the triangle inequality.
    """
    c, about = np.array(center_of_mass, dtype=np.float64), np.array(tensor, dtype=np.float64)
    if not (np.isfinite(mass) and mass > 0.0):
        raise InvalidOption(f"a mass is {mass} kg", hint="Give a positive finite number.")
    if c.shape != (3,) or about.shape != (3, 3):
        raise InvalidOption(
            f"a centre of mass has shape {c.shape}, an inertia {about.shape}",
            hint="Give three numbers [m], and 3 x 3 [kg m^2] about the centre of mass.",
        )
    if not (np.isfinite(c).all() and np.isfinite(about).all()):
        raise InvalidOption("a centre of mass or inertia is not finite")
    moments = np.linalg.eigvalsh(0.5 * (about + about.T))
    slack = moment_rounding(about.tolist())
    if asymmetry(about.tolist()) > tensor_rounding(about.tolist()) or moments[0] < -slack:
        raise InvalidOption(
            "an inertia tensor is not symmetric and positive semidefinite",
            hint="Give it about the centre of mass, in the axes of the link.",
        )
    if moments[2] > moments[0] + moments[1] + 2.0 * slack:
        raise InvalidOption(
            f"the principal moments {moments[0]:.6g}, {moments[1]:.6g}, {moments[2]:.6g} kg m^2 "
            "are not those of a rigid body: the largest exceeds the sum of the others",
            hint="Give the tensor about the centre of mass, not about the joint.",
        )
    return Inertia(float(mass), c, 0.5 * (about + about.T))


def _not_negative(chain: Chain, name: str, value: ArrayLike) -> Array:
    values = np.array(value, dtype=np.float64)
    if values.shape not in {(), (chain.n,)} or not (np.isfinite(values) & (values >= 0)).all():
        raise InvalidOption(
            f"{name} must be one number that is not negative, or {chain.n}, one for each joint",
            hint=f"The order is: {', '.join(chain.joint_names)}.",
        )
    return np.array(np.broadcast_to(values, (chain.n,)))


@dataclass(frozen=True, slots=True)
class Motor:
    """A direct current motor behind a gear, theta_m = r q.

        J_m theta_m'' + (B_m + k_m k_b / R) theta_m' = (k_m / R) V - tau_load / r.

    Seen from the joint, J q'' + B q' = u - tau_load with J = r^2 J_m, B = r^2 (B_m + k_m k_b / R)
    and u = r (k_m / R) V.

    Args:
        inertia: J_m of the rotor [kg m^2].
        friction: B_m at the rotor [N m s/rad].
        torque_constant: k_m [N m/A].
        back_emf: k_b [V s/rad].
        resistance: R [ohm].
        gear_ratio: r, turns of the motor for one of the joint; for a prismatic joint [rad/m].
        voltage_limit: Largest |V| at the terminals [V]; none where it is not given.

    Raises:
        InvalidOption: A value is negative, or one that must be positive is not.
    """

    inertia: float
    friction: float = 0.0
    torque_constant: float = 1.0
    back_emf: float = 0.0
    resistance: float = 1.0
    gear_ratio: float = 1.0
    voltage_limit: float | None = None

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if value is None:
                continue
            positive = item.name not in {"inertia", "friction", "back_emf"}
            if not math.isfinite(value) or value < 0.0 or (positive and value == 0.0):
                least = "positive" if positive else "not negative"
                raise InvalidOption(
                    f"the {item.name} of a motor is {value}", hint=f"Give a number that is {least}."
                )

    @property
    def reflected_inertia(self) -> float:
        """J = r^2 J_m [kg m^2 or kg]."""
        return self.gear_ratio**2 * self.inertia

    @property
    def reflected_friction(self) -> float:
        """B = r^2 (B_m + k_m k_b / R) [N m s/rad or N s/m]."""
        electric = self.torque_constant * self.back_emf / self.resistance
        return self.gear_ratio**2 * (self.friction + electric)

    def voltage(self, u: Array) -> Array:
        """The voltage V = R u / (r k_m) that drives the joint with u [V]."""
        return np.asarray(u) * self.resistance / (self.gear_ratio * self.torque_constant)

    @property
    def torque_limit(self) -> float:
        """Largest drive |u| of the joint at the voltage limit [N m or N]; infinite without one."""
        if self.voltage_limit is None:
            return math.inf
        return float(self.torque(np.array(self.voltage_limit)))

    def torque(self, voltage: Array) -> Array:
        """The drive u = r (k_m / R) V of the joint, before friction and back-EMF [N m or N]."""
        return np.asarray(voltage) * self.gear_ratio * self.torque_constant / self.resistance


def attach_motors(chain: Chain, motors: Sequence[Motor]) -> Chain:
    """Robot with a motor at each joint.

    Raises:
        InvalidOption: There are not as many motors as joints.
    """
    if len(motors) != chain.n:
        raise InvalidOption(
            f"{len(motors)} motor(s) for the {chain.n} joints of robot {chain.name!r}",
            hint=f"One each, in the order {', '.join(chain.joint_names)}.",
        )
    J = [motor.reflected_inertia for motor in motors]
    return with_motors(chain, J, [motor.reflected_friction for motor in motors])
