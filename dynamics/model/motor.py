"""The motor of a joint: voltage in, torque out, with what it adds to the robot's inertia."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from dynamics.model.payload import with_motors
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain


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
