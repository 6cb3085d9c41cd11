"""The tree of links and joints as a value: who carries whom, and what can be changed."""

import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from kinematics.tree.description import (
    JOINT_TYPES,
    RobotDescription,
)
from kinematics.urdf.urdf import parse_urdf
from tests.kinematics.samples import TREE, arm


@pytest.fixture(scope="module")
def tree() -> RobotDescription:
    return parse_urdf(TREE)


def test_children_come_in_the_order_of_the_file(tree: RobotDescription) -> None:
    assert [joint.name for joint in tree.children("carriage")] == ["mast_joint", "shoulder"]
    assert [joint.name for joint in tree.children("hand")] == [
        "left_finger_joint",
        "right_finger_joint",
    ]
    assert tree.children("mast") == ()
    assert tree.children("nowhere") == ()


def test_every_link_but_the_root_hangs_on_one_joint(tree: RobotDescription) -> None:
    assert tree.parent_joint(tree.root) is None
    for name in tree.links:
        joint = tree.parent_joint(name)
        if name == tree.root:
            continue
        assert joint is not None
        assert joint.child == name
        assert joint in tree.children(joint.parent)


@pytest.mark.parametrize("kind", JOINT_TYPES)
def test_only_joints_of_one_degree_of_freedom_move(kind: str) -> None:
    joint = parse_urdf(arm(type=kind)).joints["swing"]
    assert joint.moves == (kind in {"revolute", "continuous", "prismatic"})


def test_maps_and_arrays_cannot_be_changed(tree: RobotDescription) -> None:
    with pytest.raises(TypeError):
        del tree.joints["slide"]  # type: ignore[attr-defined]
    with pytest.raises(FrozenInstanceError):
        tree.root = "hand"  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        tree.joints["slide"].T_parent_joint[0, 3] = 1.0
    solid = tree.links["carriage"].collisions[0]
    with pytest.raises(ValueError, match="read-only"):
        solid.T_link_element[0, 3] = 1.0


def test_pickling_keeps_every_field(tree: RobotDescription) -> None:
    copy = pickle.loads(pickle.dumps(tree))
    assert (copy.name, copy.root, copy.lint) == (tree.name, tree.root, tree.lint)
    for name, joint in tree.joints.items():
        other = copy.joints[name]
        assert (other.type, other.parent, other.child, other.mimic) == (
            joint.type,
            joint.parent,
            joint.child,
            joint.mimic,
        )
        np.testing.assert_array_equal(other.T_parent_joint, joint.T_parent_joint)
        np.testing.assert_array_equal(
            [other.lower, other.upper, other.velocity], [joint.lower, joint.upper, joint.velocity]
        )
    for name, link in tree.links.items():
        assert [c.geometry for c in copy.links[name].collisions] == [
            c.geometry for c in link.collisions
        ]
