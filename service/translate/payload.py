"""Payloads from wire to domain."""

import numpy as np

from armwright_wire.robots.payload import Payload
from armwright_wire.robots.robot import LinkInertia, RobotInertias
from dynamics.model.payload import IdentifiedBodies, inertia, with_payload
from kinematics.model.chain import Chain, Inertia


def loaded_chain(chain: Chain, payload: Payload) -> Chain:
    """The chain of a robot with a payload.

    Raises:
        InvalidOption: It is no body.
        InvalidLinkName: What should carry it does not exist.
    """
    tensor = None if payload.inertia is None else np.array(payload.inertia)
    return with_payload(chain, payload.mass, payload.center_of_mass, tensor, link=payload.link)


def identified_bodies(given: RobotInertias) -> IdentifiedBodies:
    """The bodies and drives that a robot has in place of its description's.

    Raises:
        InvalidOption: One is no body.
    """
    return IdentifiedBodies(
        {
            name: inertia(body.mass, body.center_of_mass, body.inertia)
            for name, body in given.links.items()
        },
        given.motor_inertia,
        given.viscous_friction,
        given.coulomb_friction,
    )


def inertias_answer(found: IdentifiedBodies, origin: str) -> RobotInertias:
    """Bodies and drives as requests for robots take them."""
    drives = (found.motor_inertia, found.viscous_friction, found.coulomb_friction)
    J, B, F = (None if drive is None else np.asarray(drive).tolist() for drive in drives)
    return RobotInertias(
        origin=origin,
        links={name: link_inertia(body) for name, body in found.links.items()},
        motor_inertia=J,
        viscous_friction=B,
        coulomb_friction=F,
    )


def link_inertia(body: Inertia) -> LinkInertia:
    """A body as requests take it."""
    center, tensor = body.center_of_mass.tolist(), body.tensor.tolist()
    return LinkInertia(mass=body.mass, center_of_mass=center, inertia=tensor)
