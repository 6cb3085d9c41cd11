"""MJCF models read as robots, held against MuJoCo's own numbers: joints, frames, geoms, pairs.

``python -m benchmarks.judges.mujoco_models FOLDER...`` reads every model below the folders, and
prints for each the largest difference of poses and of support functions over random configurations
[m], and how many pairs of bodies one of the two lets collide and the other does not.
"""

import argparse
import struct
from base64 import b64decode
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from armwright_client import InvalidArgument
from armwright_client.robots.mjcf import read_mjcf
from armwright_client.robots.sources import UrdfFile, is_mjcf
from kinematics.arrays import Array
from kinematics.tree import description as shapes
from kinematics.tree.srdf import parse_srdf
from kinematics.urdf.urdf import parse_urdf

CONFIGURATIONS = 20
DIRECTIONS = 30
#: Pairs nearer than these are contacts for MuJoCo [m]: in the end all that it does not filter out.
#: Its test of two boxes finds none with a margin much larger than they are.
MARGINS = (0.1, 0.3, 1.0, 50.0)
#: Memory for the contacts of all pairs [byte].
ARENA = 1 << 30


class Differences(NamedTuple):
    """Differences from MuJoCo.

    Attributes:
        joints: Hinges and slides.
        order: Whether joints come in MuJoCo's order, with its ranges.
        pose: Of positions and rotation matrices of bodies and sites.
        support: Of the supports of colliding geoms in the world [m].
        pairs: Pairs of bodies that only one of the two lets collide.
        solid: Pairs of bodies that have colliding geoms.
    """

    joints: int
    order: bool
    pose: float
    support: float
    pairs: int
    solid: int


def differences(path: Path, seed: int = 0) -> Differences:
    """The differences of a model that is read here from the one that MuJoCo compiles.

    Args:
        path: Path of the MJCF file.
        seed: Seed of the configurations.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    spec.memory = ARENA
    model = spec.compile()
    file = read_mjcf(path, 0)
    tree = parse_urdf(file.text)
    data, random = mujoco.MjData(model), np.random.default_rng(seed)
    pose = support = 0.0
    for _ in range(CONFIGURATIONS):
        joints = drawn(model, data, random)
        frames = placed(tree, joints)
        pose = max(pose, pose_difference(model, data, frames))
        support = max(support, support_difference(model, data, (tree, file), frames, random))
    allowed = parse_srdf(file.srdf or "").disabled_collisions
    solid = sorted(link.name for link in tree.links.values() if link.collisions)
    every = {(a, b) for i, a in enumerate(solid) for b in solid[i + 1 :]}
    pairs = (every - allowed) ^ colliding(model, set(tree.links))
    return Differences(
        len(ordered(model)), same_joints(model, tree), pose, support, len(pairs), len(every)
    )


def ordered(model: Any) -> list[int]:
    """Hinges and slides, in order."""
    kinds = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    return [joint for joint in range(model.njnt) if mujoco.mjtJoint(model.jnt_type[joint]) in kinds]


def drawn(model: Any, data: Any, random: np.random.Generator) -> dict[str, float]:
    """Random positions of all joints, set and carried out by MuJoCo."""
    data.qpos[:] = model.qpos0
    joints: dict[str, float] = {}
    for joint in ordered(model):
        value = float(random.uniform(-2.0, 2.0))
        data.qpos[model.jnt_qposadr[joint]] = value
        joints[model.joint(joint).name or f"joint{joint}"] = value
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return joints


def placed(tree: shapes.RobotDescription, joints: Mapping[str, float]) -> dict[str, Array]:
    """Poses of all links of a URDF, its joints where they are put, whatever follows others."""
    frames: dict[str, Array] = {tree.root: np.eye(4)}
    left = list(tree.joints.values())
    while left:
        for joint in [joint for joint in left if joint.parent in frames]:
            motion = np.eye(4)
            if joint.type == "prismatic":
                motion[:3, 3] = joint.axis * joints[joint.name]
            elif joint.type != "fixed":
                turn = Rotation.from_rotvec(joint.axis * joints[joint.name])
                motion[:3, :3] = turn.as_matrix()
            frames[joint.child] = frames[joint.parent] @ joint.T_parent_joint @ motion
            left.remove(joint)
    return frames


def pose_difference(model: Any, data: Any, frames: Mapping[str, Array]) -> float:
    """The largest difference of a pose; of bodies that are no links nothing is said."""
    worst = 0.0
    for number in range(1, model.nbody):
        frame = frames.get(model.body(number).name or f"body{number}")
        if frame is not None:
            worst = max(worst, float(np.abs(frame[:3, 3] - data.xpos[number]).max()))
            turn = frame[:3, :3] - data.xmat[number].reshape(3, 3)
            worst = max(worst, float(np.abs(turn).max()))
    for number in range(model.nsite):
        name = model.site(number).name
        if name and name in frames and mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) < 0:
            worst = max(worst, float(np.abs(frames[name][:3, 3] - data.site_xpos[number]).max()))
    return worst


def support_difference(
    model: Any,
    data: Any,
    robot: tuple[shapes.RobotDescription, UrdfFile],
    frames: Mapping[str, Array],
    random: np.random.Generator,
) -> float:
    """The largest difference of supports of colliding geoms, which must be as many [m]."""
    tree, file = robot
    worst = 0.0
    for number in range(1, model.nbody):
        name = model.body(number).name or f"body{number}"
        if name not in tree.links:
            continue
        first, count = model.body_geomadr[number], model.body_geomnum[number]
        geoms = [
            geom
            for geom in range(first, first + count)
            if model.geom_contype[geom] or model.geom_conaffinity[geom]
        ]
        solids = tree.links[name].collisions
        assert len(geoms) == len(solids), name
        for geom, solid in zip(geoms, solids, strict=True):
            frame = frames[name] @ solid.T_link_element
            for direction in random.normal(size=(DIRECTIONS, 3)):
                unit = direction / np.linalg.norm(direction)
                here = float(unit @ frame[:3, 3])
                here += support_here(solid.geometry, file, frame[:3, :3].T @ unit)
                there = float(unit @ data.geom_xpos[geom])
                there += support_there(model, geom, data.geom_xmat[geom].reshape(3, 3).T @ unit)
                worst = max(worst, abs(here - there))
    return worst


def support_here(shape: shapes.Geometry, file: UrdfFile, unit: Array) -> float:
    """The support of a shape of a URDF in its own frame [m]."""
    across = float(np.hypot(unit[0], unit[1]))
    match shape:
        case shapes.SphereGeometry():
            return shape.radius
        case shapes.CapsuleGeometry():
            return shape.radius + 0.5 * shape.length * abs(float(unit[2]))
        case shapes.CylinderGeometry():
            return shape.radius * across + 0.5 * shape.length * abs(float(unit[2]))
        case shapes.BoxGeometry():
            return 0.5 * float(np.abs(unit) @ np.array(shape.size))
    content = b64decode(file.meshes[shape.uri])
    (count,) = struct.unpack_from("<I", content, 80)
    rows = np.frombuffer(content, np.dtype([("v", "<f4", 12), ("a", "<u2")]), count, 84)
    return float((rows["v"][:, 3:].reshape(-1, 3) @ unit).max())


def support_there(model: Any, geom: int, unit: Array) -> float:
    """The support of a geom of MuJoCo in its own frame [m]."""
    size, across = model.geom_size[geom], float(np.hypot(unit[0], unit[1]))
    match mujoco.mjtGeom(model.geom_type[geom]):
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return float(size[0])
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            return float(size[0] + size[1] * abs(unit[2]))
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return float(size[0] * across + size[1] * abs(unit[2]))
        case mujoco.mjtGeom.mjGEOM_BOX:
            return float(np.abs(unit) @ size)
    mesh = model.geom_dataid[geom]
    start = model.mesh_vertadr[mesh]
    return float((model.mesh_vert[start : start + model.mesh_vertnum[mesh]] @ unit).max())


def colliding(model: Any, links: set[str]) -> set[tuple[str, str]]:
    """Pairs of bodies that MuJoCo finds contacts of, were they as near as a margin."""
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
    bodies = {number: model.body(number).name or f"body{number}" for number in range(model.nbody)}
    data, random = mujoco.MjData(model), np.random.default_rng(0)
    found = set()
    for margin in MARGINS * CONFIGURATIONS:
        drawn(model, data, random)
        model.geom_margin[:] = margin
        mujoco.mj_collision(model, data)
        for contact in data.contact:
            a, b = sorted(bodies[int(model.geom_bodyid[geom])] for geom in contact.geom)
            if {a, b} <= links and a != b and "world" not in (a, b):
                found.add((a, b))
    return found


def same_joints(model: Any, tree: shapes.RobotDescription) -> bool:
    """Whether joints have MuJoCo's order, kinds and ranges."""
    here = [
        (joint.name, joint.type, joint.lower, joint.upper)
        for joint in tree.joints.values()
        if joint.type != "fixed"
    ]
    there = []
    for number in ordered(model):
        slides = mujoco.mjtJoint(model.jnt_type[number]) == mujoco.mjtJoint.mjJNT_SLIDE
        limited = bool(model.jnt_limited[number])
        low, high = model.jnt_range[number] if limited else (-np.inf, np.inf)
        kind = "prismatic" if slides else "revolute" if limited else "continuous"
        if slides and not limited:
            low = high = np.nan
        there.append((model.joint(number).name or f"joint{number}", kind, low, high))
    return len(here) == len(there) and all(
        a[:2] == b[:2] and np.array_equal(a[2:], b[2:], equal_nan=True)
        for a, b in zip(here, there, strict=True)
    )


def main() -> None:
    """Print the differences of every model below the folders that are named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", type=Path, nargs="+")
    for folder in parser.parse_args().folders:
        for path in sorted(path for path in folder.rglob("*.xml") if is_mjcf(path)):
            name = str(path.relative_to(folder))
            try:
                found = differences(path)
            except (InvalidArgument, ValueError) as error:
                print(f"{name}: {str(error)[:160]}")
                continue
            print(
                f"{name}: {found.joints} joints, order and ranges {found.order}, "
                f"poses {found.pose:.1e}, supports {found.support:.1e} m, "
                f"{found.pairs} of {found.solid} pairs differ"
            )


if __name__ == "__main__":
    main()
