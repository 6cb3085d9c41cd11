"""Motors that drive the joints of a robot."""

from armwright_client.base import NonNegative, Positive, Request


class Motor(Request):
    """A direct current motor behind a gear: J q̈ + B q̇ = u − load with u = r (k_m / R) V.

    Args:
        inertia: J_m of the rotor [kg m²]; J = r² J_m.
        friction: B_m at the rotor [N m s/rad]; B = r² (B_m + k_m k_b / R).
        torque_constant: k_m [N m/A].
        back_emf: k_b [V s/rad].
        resistance: R [ohm].
        gear_ratio: r, turns of the motor for one of the joint.
        voltage_limit: Largest |V| at the terminals [V].
    """

    inertia: NonNegative
    friction: NonNegative = 0.0
    torque_constant: Positive = 1.0
    back_emf: NonNegative = 0.0
    resistance: Positive = 1.0
    gear_ratio: Positive = 1.0
    voltage_limit: Positive | None = None
