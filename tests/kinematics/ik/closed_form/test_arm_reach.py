"""Reach of arms by the edge of their workspace and by their closed forms."""

import numpy as np
import pytest

from kinematics.forward import forward, joint_frames
from kinematics.ik.closed_form.analytic import branches
from kinematics.ik.closed_form.arm_reach import out_of_reach
from kinematics.ik.inverse import IkOptions, inverse_kinematics
from kinematics.ik.numeric.numeric import Axis
from kinematics.model.dh import chain_from_dh
from kinematics.model.dh_table import DhRow, DhTable
from kinematics.robots import builtin_chain


@pytest.mark.parametrize("name", ["elbow_wrist", "puma560", "kr6_sixx", "ur5e"])
def test_out_of_reach_is_where_there_is_no_branch(name: str) -> None:
    chain = builtin_chain(name)
    rng = np.random.default_rng(5)
    near = far = 0
    for q in rng.uniform(-3.0, 3.0, (60, 6)):
        T = forward(chain, q)
        assert out_of_reach(chain, T) == pytest.approx(0.0, abs=1e-9)
        T[:3, 3] *= rng.uniform(0.05, 2.5)
        gap = out_of_reach(chain, T)
        assert gap is not None
        assert (len(branches(chain, T).joints) == 0) == (gap > 1e-9)
        near, far = near + (gap == 0.0), far + (gap > 0.0)
    assert min(near, far) > 5


def test_the_gap_of_a_stretched_arm_is_the_way_beyond_it() -> None:
    """The notes' arm, stretched to the side, and then moved on along its line."""
    chain = builtin_chain("elbow_wrist")
    frames = joint_frames(chain, np.zeros(6))
    T = forward(chain, np.zeros(6))
    W = frames[4, :3, 3]
    a = np.linalg.norm(frames[2, :3, 3] - frames[1, :3, 3])
    b = np.linalg.norm(W - frames[2, :3, 3])
    T[:3, 3] += frames[1, :3, 3] + [a + b + 0.123, 0.0, 0.0] - W
    assert out_of_reach(chain, T) == pytest.approx(0.123, abs=1e-9)


@pytest.mark.parametrize("name", ["panda", "iiwa14"])
def test_seven_joints_are_out_of_reach_where_no_parameter_has_a_branch(name: str) -> None:
    chain = builtin_chain(name)
    rng = np.random.default_rng(9)
    near = far = 0
    for q in rng.uniform(-3.0, 3.0, (60, 7)):
        T = forward(chain, q)
        assert out_of_reach(chain, T) == pytest.approx(0.0, abs=1e-9)
        T[:3, 3] *= rng.uniform(0.05, 2.5)
        gap = out_of_reach(chain, T)
        assert gap is not None
        found = branches(chain, T, parameters=np.linspace(-3.1, 3.1, 60)).joints
        assert (len(found) == 0) == (gap > 1e-9)
        near, far = near + (gap == 0.0), far + (gap > 0.0)
    assert min(near, far) > 5


def test_the_gap_of_a_planar_arm() -> None:
    chain = builtin_chain("planar_rr")  # two links of 1 m about -y
    target = np.eye(4)
    target[:3, 3] = [1.8, 0.0, 2.4]
    assert out_of_reach(chain, target) == pytest.approx(1.0, abs=1e-12)
    target[:3, 3] = [1.0, 0.5, 0.0]
    assert out_of_reach(chain, target) == pytest.approx(0.5, abs=1e-12)
    # Where only x and z count, the distance along y does not.
    assert out_of_reach(chain, target, axes=("x", "z")) == pytest.approx(0.0, abs=1e-12)
    assert out_of_reach(chain, target, axes=("x", "y")) is None
    rows = (DhRow("revolute", a=0.7), DhRow("revolute", a=0.3))
    uneven = chain_from_dh("uneven", DhTable("standard", rows))
    target[:3, 3] = [0.1, 0.0, 0.0]
    assert out_of_reach(uneven, target) == pytest.approx(0.3, abs=1e-12)


def test_the_gap_of_a_scara_is_that_across_its_axes() -> None:
    chain = builtin_chain("scara")
    T = forward(chain, np.zeros(4))
    T[:3, 3] += [0.2, 0.0, -5.0]
    assert out_of_reach(chain, T) == pytest.approx(0.2, abs=1e-12)


def test_the_shoulder_offset_of_the_stanford_arm_bounds_its_reach() -> None:
    chain = builtin_chain("stanford")
    T = forward(chain, [0.3, 0.5, 0.6, 0.1, 0.4, 0.2])
    assert out_of_reach(chain, T) == pytest.approx(0.0, abs=1e-12)
    W = joint_frames(chain, np.zeros(6))[4, :3, 3]
    T = forward(chain, np.zeros(6))
    T[:3, 3] += np.array([0.0, 0.1, 0.6]) - W  # 0.1 m from axis 1, nearer than the offset 0.154
    assert out_of_reach(chain, T) == pytest.approx(0.054, abs=1e-9)


def test_the_position_of_three_joints() -> None:
    rows = (DhRow("revolute", d=0.4, alpha=np.pi / 2), DhRow("revolute", a=0.5),
            DhRow("revolute", a=0.35))  # fmt: skip
    chain = chain_from_dh("articulated", DhTable("standard", rows))
    target = np.eye(4)
    target[:3, 3] = [0.6, 0.8, 0.4]
    position: tuple[Axis, ...] = ("x", "y", "z")
    assert out_of_reach(chain, target, axes=position) == pytest.approx(0.15, abs=1e-12)
    assert out_of_reach(chain, target, axes=("x", "y")) is None
    result = inverse_kinematics(chain, target, IkOptions(axes=position))
    assert result.solutions == ()
    assert result.out_of_reach == pytest.approx(0.15, abs=1e-12)
    assert result.nearest.position_error == pytest.approx(0.15, abs=1e-6)
    assert result.starts <= 20
