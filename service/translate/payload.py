"""Payloads from wire to domain."""

import numpy as np

from armwright_wire.robots.dynamics import Payload
from dynamics.model.payload import with_payload
from kinematics.model.chain import Chain


def loaded_chain(chain: Chain, payload: Payload) -> Chain:
    """The chain of a robot with a payload.

    Raises:
        InvalidOption: It is no body.
        InvalidLinkName: What should carry it does not exist.
    """
    tensor = None if payload.inertia is None else np.array(payload.inertia)
    return with_payload(chain, payload.mass, payload.center_of_mass, tensor, link=payload.link)
