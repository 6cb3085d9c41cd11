"""Motors on the wire, in requests and answers alike."""

from pydantic import Field

from armwright_wire.base import Body, NonNegative, Positive


class Motor(Body):
    """A direct current motor behind a gear, seen from the joint as J q̈ + B q̇ = u − load."""

    inertia: NonNegative = Field(description="J_m of the rotor [kg m²]")
    friction: NonNegative = Field(0.0, description="B_m at the rotor [N m s/rad]")
    torque_constant: Positive = Field(1.0, description="k_m [N m/A]")
    back_emf: NonNegative = Field(0.0, description="k_b [V s/rad]")
    resistance: Positive = Field(1.0, description="R [ohm]")
    gear_ratio: Positive = Field(1.0, description="turns of the motor for one of the joint")
    voltage_limit: Positive | None = Field(
        None,
        description="largest |V| at its terminals [V]: with `saturate` torques are cut off there",
    )
