"""The parameters that an identification looks for: those of bodies, and those of drives."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from dynamics.identification.consistent import (
    BASIS,
    PARAMETERS,
    believed_body,
    moments,
)
from dynamics.identification.log import Samples
from dynamics.inverse import inverse_dynamics
from dynamics.model.body import SMOOTH_SPEED, massless_joints
from dynamics.parameters.base_parameters import (
    BaseParameters,
    elimination_order,
    found_base,
    random_motions,
)
from dynamics.parameters.regressor import (
    BODY_PARAMETERS,
    parameter_names,
    regressor,
    standard_parameters,
)
from kinematics.arrays import Array
from kinematics.model.chain import Chain, Inertia

Drive = Literal["motor_inertia", "viscous_friction", "coulomb_friction", "offset"]
#: Name of each parameter of a drive, before the number of its joint.
DRIVES: dict[Drive, str] = {
    "motor_inertia": "J",
    "viscous_friction": "B",
    "coulomb_friction": "F",
    "offset": "offset",
}
#: Mass [kg] that a body of which nothing is known has, and its size [m].
_MASS, _SIZE = 1.0, 0.2
#: The same of a load.
_LOAD_MASS, _LOAD_SIZE = 5.0, 0.1


def with_believed_bodies(chain: Chain) -> tuple[Chain, tuple[str, ...]]:
    """The chain with a body at each joint, and the joints that had none."""
    bare = massless_joints(chain)
    if not bare:
        return chain, ()
    body = Inertia(_MASS, np.zeros(3), 0.1 * _MASS * _SIZE**2 * np.eye(3))
    first = {
        next(k for k, link in enumerate(chain.links) if link.joint == joint): joint
        for joint in bare
        if any(link.joint == joint for link in chain.links)
    }
    links = tuple(
        replace(link, inertia=body) if k in first else link for k, link in enumerate(chain.links)
    )
    return replace(chain, links=links), tuple(chain.joint_names[i] for i in sorted(first.values()))


@dataclass(frozen=True, slots=True, eq=False)
class Unknowns:
    """Parameters to be found, in which torques are linear.

    Args:
        chain: The robot as it is believed to be.
        drives: Parameters of the drives to be found too; others are those of the robot.
        link: Link whose load is sought, all else being known; None where the robot is.
    """

    chain: Chain
    drives: tuple[Drive, ...]
    link: str | None = None
    base: BaseParameters = field(init=False)

    def __post_init__(self) -> None:
        motions = random_motions(self.chain)
        W = self.regressor(*motions)
        names = self.names
        R = np.asarray(np.linalg.qr(W.reshape(-1, len(names)), mode="r"))
        if self.link is None:
            order = elimination_order(self.chain.n, names)
        else:
            order = list(range(len(names)))
        object.__setattr__(self, "base", found_base(R, order, names, self.known()))

    @property
    def bodies(self) -> int:
        """Number of bodies whose parameters are sought."""
        return self.chain.n if self.link is None else 1

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all p parameters: bodies, then drives; a load's have no number."""
        bodies = parameter_names(self.chain, motors=False)
        if self.link is not None:
            bodies = BODY_PARAMETERS
        numbers = range(1, self.chain.n + 1)
        return (*bodies, *(f"{DRIVES[drive]}{i}" for drive in self.drives for i in numbers))

    def known(self) -> Array:
        """The parameters as they are believed to be, shape (p,)."""
        if self.link is None:
            bodies = standard_parameters(self.chain, motors=False)
        else:
            bodies = np.zeros(PARAMETERS)
        return np.concatenate([bodies, *(self._drive(drive) for drive in self.drives)])

    def _drive(self, drive: Drive) -> Array:
        if drive == "offset":
            return np.zeros(self.chain.n)
        value: Array = getattr(self.chain, drive)
        return value

    def regressor(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Regressor of the unknowns, shape (m, n, p)."""
        Y = regressor(self.chain, q, qd, qdd, motors=False)
        if self.link is not None:
            carrier = self.chain.link(self.link)
            own = Y[..., PARAMETERS * carrier.joint : PARAMETERS * (carrier.joint + 1)]
            T = carrier.T_joint_link
            Y = own @ moments(T @ BASIS @ T.T).T
        parts = [Y]
        for drive in self.drives:
            diagonal = {
                "motor_inertia": qdd,
                "viscous_friction": qd,
                "coulomb_friction": np.tanh(qd / SMOOTH_SPEED),
                "offset": np.ones_like(q),
            }[drive]
            parts.append(diagonal[..., None] * np.eye(self.chain.n))
        return np.concatenate(parts, axis=-1)

    def known_torques(self, samples: Samples) -> Array:
        """Torques of all that is not sought, shape (m, n) [N m or N]."""
        state = samples.q, samples.qd, samples.qdd
        rest = inverse_dynamics(self.chain, *state)
        sought = self.known()
        return np.asarray(rest - self.regressor(*state) @ sought)

    def sizes(self, torque: Array) -> Array:
        """Plausible sizes of all parameters, shape (p,).

        Args:
            torque: Root mean square of the torques at each joint, shape (n,) [N m or N].
        """
        chain = self.chain
        mass, length = _LOAD_MASS, _LOAD_SIZE
        if self.link is None:
            mass = float(standard_parameters(chain, motors=False)[::PARAMETERS].mean())
            length = max(_SIZE, np.linalg.norm(chain.offsets[1:, :3, 3], axis=1).mean())
        body = np.array([mass, *[mass * length] * 3, *[mass * length**2] * 6])
        drive = {
            "motor_inertia": np.full(chain.n, mass * length**2),
            "viscous_friction": torque,
            "coulomb_friction": torque,
            "offset": torque,
        }
        return np.concatenate([np.tile(body, self.bodies), *(drive[k] for k in self.drives)])

    def believed(self, sizes: Array) -> Array:
        """Parameters that bodies with positive densities and drives have, shape (p,).

        Args:
            sizes: Plausible sizes of the parameters, shape (p,).
        """
        known, split = self.known(), PARAMETERS * self.bodies
        mass = sizes[0]
        length = float(sizes[1] / mass)
        bodies = [
            believed_body(known[i : i + PARAMETERS], mass, length)
            for i in range(0, split, PARAMETERS)
        ]
        rest = np.where(known[split:] > 0.0, known[split:], sizes[split:])
        return np.concatenate([*bodies, rest])
