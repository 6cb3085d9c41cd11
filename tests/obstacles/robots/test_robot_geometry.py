"""A robot's solid: where its pieces are, and which of them are checked."""

import pickle
from typing import Any

import numpy as np
import pytest
import trimesh

from kinematics.errors import InvalidRobotDescription
from kinematics.forward import link_poses
from kinematics.model.chain import Chain
from kinematics.pose import transform
from kinematics.robots import builtin_names, builtin_srdf, builtin_urdf
from kinematics.tree.description import RobotDescription
from kinematics.tree.serial_chain import serial_chain
from kinematics.tree.srdf import Semantics, parse_srdf
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.fcl_distance import FclWorld
from obstacles.convex.piece import PieceKind
from obstacles.distance.signed_distance import signed_distance
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scenes.scene import Scene


def link(name: str, *solids: str) -> str:
    body = "".join(
        f'<collision><origin xyz="0.2 0 0"/><geometry>{s}</geometry></collision>' for s in solids
    )
    return f'<link name="{name}">{body}</link>'


def joint(name: str, parent: str, child: str, kind: str = "revolute", xyz: str = "0.4 0 0") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="0 0 1"/>'
        '<limit lower="-3" upper="3" velocity="1" effort="1"/></joint>'
    )


BAR = '<box size="0.45 0.05 0.05"/>'
BALL = '<sphere radius="0.03"/>'
#: base - j1 - one - j2 - bare (no solid) - fixed - two - j3 - three - fixed - tool
URDF = (
    '<robot name="snake">'
    + link("base", '<box size="0.3 0.3 0.1"/>')
    + link("one", BAR)
    + link("bare")
    + link("two", BAR, BALL)
    + link("three", '<cylinder radius="0.03" length="0.4"/>')
    + link("tool", BALL)
    + joint("j1", "base", "one", xyz="0 0 0.2")
    + joint("j2", "one", "bare")
    + joint("mount", "bare", "two", "fixed", "0 0 0.1")
    + joint("j3", "two", "three")
    + joint("flange", "three", "tool", "fixed", "0 0 0.3")
    + "</robot>"
)


def built(
    urdf: str = URDF, meshes: Any = None, semantics: Semantics | None = None
) -> tuple[RobotGeometry, Chain, RobotDescription]:
    description = parse_urdf(urdf)
    chain = serial_chain(description)
    return robot_geometry(chain, description, meshes, semantics), chain, description


def test_pieces_follow_their_links() -> None:
    geometry, chain, _ = built()
    assert geometry.links == ("base", "one", "two", "two", "three", "tool")
    assert geometry.joints.tolist() == [-1, 0, 1, 1, 2, 2]
    kinds = [PieceKind.POLYTOPE] * 4 + [PieceKind.CYLINDER, PieceKind.POLYTOPE]
    assert [piece.kind for piece in geometry.pieces] == kinds

    random = np.random.default_rng(0)
    world = FclWorld(geometry, Scene())
    for q in random.uniform(-3.0, 3.0, (10, 3)):
        world.set_configuration(q)
        poses = dict(zip((k.name for k in chain.links), link_poses(chain, q), strict=True))
        for i, name in enumerate(geometry.links):
            expected = poses[name] @ transform(None, [0.2, 0.0, 0.0])
            np.testing.assert_allclose(world._poses[i], expected, atol=1e-12)


def test_neighbours_are_allowed_across_links_without_solids() -> None:
    geometry, _, _ = built()
    assert geometry.allowed == {
        ("base", "one"): "adjacent",
        ("one", "two"): "adjacent",
        ("three", "two"): "adjacent",
        ("three", "tool"): "same body",
    }
    checked = {tuple(geometry.links[k] for k in pair) for pair in geometry.self_pairs}
    assert checked == {
        ("base", "two"), ("base", "three"), ("base", "tool"), ("one", "three"), ("one", "tool"),
        ("two", "tool"),
    }  # fmt: skip


def test_what_always_touches_is_allowed_and_what_never_did_is_not() -> None:
    # A slab on the first link that the last ones are in wherever they turn.
    slab = '<box size="3 3 0.5"/>'
    geometry, _, _ = built(URDF.replace(link("one", BAR), link("one", slab)))
    assert geometry.allowed[("one", "three")] == "always"
    # The base is too low to be met by the others, but nothing proves it.
    assert ("base", "two") not in geometry.allowed


def test_the_srdf_decides_where_there_is_one() -> None:
    text = (
        '<robot name="snake"><disable_collisions link1="two" link2="base" reason="Never"/>'
        '<disable_collisions link1="gripper" link2="base" reason="Never"/></robot>'
    )
    geometry, _, _ = built(semantics=parse_srdf(text))
    assert geometry.allowed[("base", "two")] == "srdf"
    assert ("base", "one") not in geometry.allowed
    assert geometry.allowed[("three", "tool")] == "same body"
    silent, _, _ = built(semantics=parse_srdf('<robot name="snake"/>'))
    assert silent.allowed[("base", "one")] == "adjacent"


def test_defaults_of_an_srdf_say_the_same_as_its_pairs() -> None:
    newer = (
        '<robot name="snake"><disable_default_collisions link="two"/>'
        '<enable_collisions link1="base" link2="two"/></robot>'
    )
    older = (
        '<robot name="snake"><disable_collisions link1="two" link2="one"/>'
        '<disable_collisions link1="two" link2="three"/>'
        '<disable_collisions link1="two" link2="tool"/></robot>'
    )
    first, _, _ = built(semantics=parse_srdf(newer))
    second, _, _ = built(semantics=parse_srdf(older))
    assert dict(first.allowed) == dict(second.allowed)
    assert ("base", "two") not in first.allowed
    np.testing.assert_array_equal(first.self_pairs, second.self_pairs)
    enabled = '<robot name="snake"><enable_collisions link1="base" link2="one"/></robot>'
    geometry, _, _ = built(semantics=parse_srdf(enabled))
    assert ("base", "one") not in geometry.allowed, "neighbours too, where the file says so"
    assert geometry.allowed[("one", "two")] == "adjacent"


def test_the_hash_follows_the_content() -> None:
    geometry, _, _ = built()
    again, _, _ = built()
    assert geometry == again
    assert hash(geometry) == hash(again)
    copy = pickle.loads(pickle.dumps(geometry))
    assert copy == geometry
    np.testing.assert_array_equal(copy.self_pairs, geometry.self_pairs)
    longer, _, _ = built(URDF.replace('length="0.4"', 'length="0.5"'))
    looser, _, _ = built(semantics=Semantics("snake", frozenset({("base", "two")})))
    assert len({geometry.content_hash, longer.content_hash, looser.content_hash}) == 3


def mesh_urdf(uri: str, scale: str = "1 1 1") -> str:
    return URDF.replace(BALL, f'<mesh filename="{uri}" scale="{scale}"/>', 1)


def test_meshes_are_scaled_hulls_of_the_bytes_given() -> None:
    data = trimesh.creation.box([100.0, 200.0, 300.0]).export(file_type="stl")
    urdf = mesh_urdf("package://snake/meshes/part.stl", "0.001 -0.001 0.001")
    for meshes in ({"package://snake/meshes/part.stl": data}, lambda _: data):
        geometry, _, _ = built(urdf, meshes)
        piece = geometry.pieces[3]
        np.testing.assert_allclose(np.ptp(piece.vertices, axis=0), [0.1, 0.2, 0.3], atol=1e-9)
        assert geometry.lint == ()


def test_a_mesh_that_is_not_convex_is_reported() -> None:
    legs = [trimesh.creation.box([0.1, 0.1, 1.0]).apply_translation([x, 0, 0]) for x in (0, 1)]
    data = trimesh.util.concatenate(legs).export(file_type="stl")
    geometry, _, _ = built(mesh_urdf("fork.stl"), {"fork.stl": data})
    assert geometry.links.count("two") == 3
    (sentence,) = geometry.lint
    assert "'two'" in sentence
    assert "2 convex pieces" in sentence


def test_solids_that_may_be_in_millimetres_are_told() -> None:
    data = trimesh.creation.box([30.0, 40.0, 300.0]).export(file_type="stl")
    geometry, _, _ = built(mesh_urdf("part.stl"), {"part.stl": data})
    (sentence,) = geometry.lint
    assert "'part.stl' is 300 m long" in sentence
    assert 'scale="0.001 0.001 0.001"' in sentence
    rod = '<cylinder radius="30" length="400"/>'
    urdf = URDF.replace('<cylinder radius="0.03" length="0.4"/>', rod).replace(
        '<box size="0.3 0.3 0.1"/>', '<box size="30 30 0.1"/>'
    )
    # A floor may be that large: it does not move.
    (sentence,) = built(urdf)[0].lint
    assert "'three': its solid is 400 m long" in sentence
    assert "metres" in sentence


@pytest.mark.parametrize(("uri", "meshes"), [
    ("part.stl", None),
    ("part.stl", {}),
    ("part.stl", {"other.stl": b""}),
    ("part.stl", {"part.stl": b""}),
    ("part.stl", {"part.stl": b"PK\x03\x04"}),
    ("part.dae", {"part.dae": b"<COLLADA/>"}),
])  # fmt: skip
def test_a_mesh_that_is_missing_or_unreadable_is_told(uri: str, meshes: Any) -> None:
    with pytest.raises(InvalidRobotDescription, match=r"part\."):
        built(mesh_urdf(uri), meshes)


def test_a_header_without_triangles_is_no_solid() -> None:
    geometry, _, _ = built(mesh_urdf("frame.stl"), {"frame.stl": bytes(80)})
    whole, _, _ = built()
    assert len(geometry.pieces) == len(whole.pieces) - 1
    assert "'frame.stl' of link 'two'" in geometry.lint[0]
    assert "left out" in geometry.lint[0]


def test_a_robot_without_solids_says_so() -> None:
    _, chain, description = built()
    bare, _, _ = built(URDF.replace("collision", "visual"))
    for geometry in (robot_geometry(chain), bare):
        assert geometry.pieces == ()
        assert geometry.self_pairs.shape == (0, 2)
        assert "no collision geometry" in geometry.lint[0]
    assert description.links


@pytest.mark.parametrize("name", builtin_names())
def test_builtin_robots_are_free_somewhere_without_their_srdf_too(name: str) -> None:
    """Whatever is checked can be apart: nothing that is left in would always collide."""
    description = parse_urdf(builtin_urdf(name))
    chain = serial_chain(description, semantics=parse_srdf(builtin_srdf(name)))
    geometry = robot_geometry(chain, description, {})
    lower, upper = chain.sampling_bounds()
    random = np.random.default_rng(0)
    blocked = {(int(i), int(j)) for i, j in geometry.self_pairs}
    arrays = geometry.arrays

    world = FclWorld(geometry, Scene())
    for q in random.uniform(lower, upper, (20, chain.n)):
        world.set_configuration(q)
        touching = set()
        for i, j in blocked:
            balls = np.linalg.norm(world._centers[i] - world._centers[j])
            if balls > arrays.radii[i] + arrays.radii[j]:
                continue
            pieces = geometry.pieces
            bounds = signed_distance(pieces[i], world._poses[i], pieces[j], world._poses[j])
            if bounds[0] <= 0.0:
                touching.add((i, j))
        blocked = touching
    assert not blocked
