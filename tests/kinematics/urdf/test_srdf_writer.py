"""SRDF written of chains, read back by our reader and by pinocchio."""

import numpy as np
import pinocchio as pin
import pytest

from kinematics.robots import builtin_chain, builtin_urdf
from kinematics.tree.srdf import named_states, parse_srdf
from kinematics.urdf.writer import srdf_text

ALLOWED = {("hand", "link<1>"): "adjacent", ("a&b", "hand"): 'suspected: "5 mm"'}


@pytest.mark.parametrize("name", ["panda", "ur5e", "scara", "stanford"])
def test_chain_states_and_pairs_are_read_back(name: str) -> None:
    chain = builtin_chain(name)
    states = {"home": np.full(chain.n, 0.1), 'odd "&" name': np.linspace(-1.0, 1e-17, chain.n)}
    semantics = parse_srdf(srdf_text(chain, states, ALLOWED))
    assert dict(semantics.chains) == {"arm": (chain.base_link, chain.tip_link)}
    assert semantics.disabled_collisions == set(ALLOWED)
    read, _ = named_states(chain, semantics)
    assert set(read) == set(states)
    for key, q in states.items():
        np.testing.assert_array_equal(read[key], q)


def test_pinocchio_reads_the_named_states() -> None:
    chain = builtin_chain("panda")
    q = np.linspace(0.0, -0.6, 7)
    model = pin.buildModelFromXML(builtin_urdf("panda"))
    pin.loadReferenceConfigurationsFromXML(model, srdf_text(chain, {"ready": q}, {}))
    np.testing.assert_array_equal(model.referenceConfigurations["ready"][:7], q)
