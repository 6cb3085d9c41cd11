"""Impossible sets name who is in conflict and how much each would have to give."""

import time

import numpy as np

from kinematics.forward import forward
from kinematics.model.dh import chain_from_dh
from kinematics.model.dh_table import DhRow, DhTable
from kinematics.robots import builtin_chain
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.joint import JointConstraint
from planning.constraints.kinds.orientation import ConeConstraint
from planning.constraints.kinds.position import PositionConstraint
from planning.constraints.kinds.region import PlaneRegion, SphereRegion
from planning.constraints.solvers.conflict import _describe, conflict
from planning.values.deadline import Deadline

CHAIN = builtin_chain("panda")
UP = [0.0, 0.0, 1.0]


def test_what_can_hold_is_no_conflict() -> None:
    q = np.array([0.3, -0.5, 0.1, -2.0, 0.2, 1.6, 0.4])
    T = forward(CHAIN, q)
    wanted = (
        ConeConstraint(T[:3, :3].T @ UP, UP, 0.1),
        PositionConstraint(SphereRegion(T[:3, 3], 0.01)),
    )
    assert conflict(ConstraintSet(CHAIN, wanted)) is None
    assert conflict(ConstraintSet(CHAIN, ())) is None


def test_two_that_exclude_each_other_are_named_among_others() -> None:
    wanted = (
        PositionConstraint(PlaneRegion([0, 0, 0.2], UP, 0.01)),
        ConeConstraint(UP, [0.0, 0.0, -1.0], 0.5),
        PositionConstraint(PlaneRegion([0, 0, 0.6], UP, 0.01)),
        JointConstraint("panda_joint1", 0.0, 1.0, 1.0),
    )
    found = conflict(ConstraintSet(CHAIN, wanted))
    assert found is not None
    assert found.constraints == (0, 2)
    np.testing.assert_allclose(found.relaxations, 0.38, atol=1e-3)
    assert "constraint 0" in found.message
    assert "constraint 2" in found.message
    assert "0.38 m" in found.hint


def test_an_arm_of_a_thousand_kilometres_is_answered_too() -> None:
    """Rounding makes the matrix of a step indefinite there; found by random requests."""
    rows = (
        DhRow("revolute", 1e6, 124982.13042318285, 1e6, 1e6, 0.5, 1.0),
        DhRow("revolute", 1.0, -1.0, 1e6, 1e6, 0.0, 1e-300),
        DhRow("revolute", -492122.2085170258, 0.0, -1.0, 1e-9, 0.0, 1e-9),
    )
    chain = chain_from_dh("long", DhTable("standard", rows))
    place = PositionConstraint(SphereRegion([0.0, 0.8451461856615526, 0.0], 0.0))
    found = conflict(ConstraintSet(chain, (place, place)))
    assert found is not None
    assert found.constraints == (1,)
    assert "Any one of these helps" in found.hint


def test_one_that_nothing_can_reach_is_told_alone() -> None:
    wanted = (
        ConeConstraint(UP, UP, 1.0),
        PositionConstraint(SphereRegion([2.0, 0.0, 0.333], 0.1)),
    )
    found = conflict(ConstraintSet(CHAIN, wanted))
    assert found is not None
    assert found.constraints == (1,)
    # It reaches 0.855 m and a flange of 0.107 m from its shoulder.
    assert 0.8 < found.relaxations[0] < 1.3


def test_a_joint_beyond_its_limit() -> None:
    found = conflict(ConstraintSet(CHAIN, (JointConstraint("panda_joint4", 1.0, 0.1, 0.1),)))
    assert found is not None
    upper = CHAIN.limits.upper[3]
    np.testing.assert_allclose(found.relaxations, [0.9 - upper], atol=1e-5)


def test_soft_ones_are_in_nobody_s_way() -> None:
    wanted = (
        PositionConstraint(PlaneRegion([0, 0, 0.2], UP, 0.01), weight=1.0),
        PositionConstraint(PlaneRegion([0, 0, 0.6], UP, 0.01)),
    )
    assert conflict(ConstraintSet(CHAIN, wanted)) is None


def test_time_ends_the_search_for_a_conflict() -> None:
    """What is not known by then is no conflict, or one that may name more than it needs."""
    planes = [
        PositionConstraint(PlaneRegion([0, 0, 0.1 * k], UP, 0.01), link)
        for k in range(6)
        for link in (None, "panda_link5")
    ]
    wanted = ConstraintSet(CHAIN, tuple(planes))
    assert conflict(wanted, deadline=Deadline.after(0.0)) is None
    began = time.process_time()
    conflict(wanted, deadline=Deadline.after(0.05))
    assert time.process_time() - began < 0.15
    found = conflict(wanted, deadline=Deadline.after(60.0))
    assert found is not None
    assert len(found.constraints) == 2


def test_no_widening_is_told_as_a_length_of_nothing() -> None:
    wanted = ConstraintSet(CHAIN, (JointConstraint("panda_joint4", -1.0, 0.1, 0.1),))
    assert "by very little" in _describe(wanted, (0,), (1e-9,)).hint
    assert "by 0.1 rad" in _describe(wanted, (0,), (0.1,)).hint
