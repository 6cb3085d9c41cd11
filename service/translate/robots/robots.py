"""Robots from wire to domain and back."""

import base64
import dataclasses
import math
from collections.abc import Sequence
from functools import partial
from typing import Any, Literal

import numpy as np

from armwright_wire.robots import robot as schema
from armwright_wire.robots.robot import Motor
from dynamics.model.body import joints_without_inertia, massless_joints
from dynamics.model.payload import with_bodies
from kinematics.arrays import Array
from kinematics.calibration.calibrate import with_corrections
from kinematics.calibration.maker_file import with_origins
from kinematics.errors import InvalidRobotDescription, InvalidScene, located
from kinematics.ik.closed_form.structure import classify_wrist
from kinematics.model.chain import Chain, JointType
from kinematics.model.dh import DhRow, DhTable, dh_from_chain
from kinematics.readers.lint import tidy
from kinematics.readers.mesh_uri import resolve_mesh
from kinematics.robots import builtin_srdf, builtin_urdf
from kinematics.root_frame import root_notes, tool_notes
from kinematics.tree.description import RobotDescription
from kinematics.tree.fingers import fingers
from kinematics.tree.joint_limits import ALL_JOINTS, soft_limit_notes
from kinematics.tree.serial_chain import GRAVITY, select, serial_chain
from kinematics.tree.srdf import check_semantics, named_states, parse_srdf
from kinematics.urdf.urdf import parse_urdf
from kinematics.urdf.visuals import read_visuals, with_visual_solids
from obstacles.robots.dh_geometry import LinkSolid, dh_robot_geometry
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.robots.touching_pairs import suspected_pairs
from service.fields import picked
from service.translate import poses
from service.translate.payload import identified_bodies
from service.translate.robots import limits as robot_limits
from service.translate.robots.motors import reflected, robot_motors, with_robot_motors

_NEEDED_TO_TIME = ("velocity", "acceleration")


def robot(body: schema.RobotBody) -> tuple[RobotGeometry, list[str]]:
    """The domain's robot and what is odd about it. Cuts meshes, so it belongs in a worker.

    Raises:
        InvalidRobotDescription: The description is not valid.
        InvalidPose: A base or tool pose is not valid.
    """
    table = dh_table(body)
    geometry, lint = _from_urdf(body) if table is None else _from_dh(body, table)
    if isinstance(body.calibration, schema.RobotCalibration):
        corrections = {name: poses.transform(X) for name, X in body.calibration.joints.items()}
        chain = with_corrections(geometry.chain, corrections)
        geometry = dataclasses.replace(geometry, chain=chain)
        lint = [*lint, f"calibration: {body.calibration.origin}"]
    if body.inertias is not None:
        chain = with_bodies(geometry.chain, identified_bodies(body.inertias))
        geometry = dataclasses.replace(geometry, chain=chain)
        lint = [*lint, f"inertias: {body.inertias.origin}"]
    return geometry, [
        *lint,
        *_limit_lint(geometry.chain),
        *_mass_lint(geometry.chain),
        *geometry.lint,
    ]


def built_in(name: str) -> tuple[RobotGeometry, list[str]]:
    """A robot that comes with the app.

    Raises:
        InvalidOption: There is no such robot.
    """
    return robot(schema.RobotBody(name=name, urdf=builtin_urdf(name), srdf=builtin_srdf(name)))


def _from_urdf(body: schema.RobotBody) -> tuple[RobotGeometry, list[str]]:
    description = _description(body)
    semantics = None if body.srdf is None else parse_srdf(body.srdf)
    lint = list(description.lint)
    if semantics is not None:
        lint += check_semantics(semantics, description)
    ends = (body.base_link, body.tip_link)
    chosen = select(description, *ends, held=body.held, semantics=semantics)
    limits, more = robot_limits.joint_limits(body.joint_limits, chosen.joints, description.joints)
    lint += more
    chain = serial_chain(
        description, *ends, held=body.held, joint_limits=limits, semantics=semantics
    )
    chain, more = robot_limits.with_rules(
        dataclasses.replace(chain, name=body.name), body.default_limits
    )
    chain = with_robot_motors(chain, body)
    joints = tuple(description.joints.values())
    soft = soft_limit_notes(joints, chain.limits, chain.joint_names)
    lint += [*more, *soft, *root_notes(chain), *tool_notes(chain)]
    files = {uri: base64.b64decode(text) for uri, text in (body.meshes or {}).items()}
    geometry = robot_geometry(chain, description, partial(resolve_mesh, uploaded=files), semantics)
    geometry = dataclasses.replace(geometry, fingers=fingers(description, chosen, semantics))
    if semantics is not None:
        states, more = named_states(chain, semantics)
        geometry = dataclasses.replace(geometry, states=states)
        lint += more
    if semantics is None or not semantics.names_allowed_pairs:
        geometry, more = _with_suspects(geometry, body.allow_suspected)
        lint += more
    return geometry, [*lint, *chosen.lint]


def _description(body: schema.RobotBody) -> RobotDescription:
    description = parse_urdf(body.urdf or "")
    given = body.calibration
    file = given.file if isinstance(given, schema.RobotCalibration) else given
    if file is not None:
        description = with_origins(description, file)
    if not body.visual_solids:
        return description
    return with_visual_solids(description, read_visuals(body.urdf or ""))


def _with_suspects(geometry: RobotGeometry, allow: bool) -> tuple[RobotGeometry, list[str]]:
    """The robot with the pairs that touch where it surely may stand, allowed or told."""
    suspected = suspected_pairs(geometry)
    if not suspected:
        return geometry, []
    listed = ", ".join(f"{a} and {b} ({reason})" for (a, b), reason in suspected.items())
    if allow:
        reasons = {pair: f"suspected: {reason}" for pair, reason in suspected.items()}
        allowed = {**geometry.allowed, **reasons}
        told = f"pairs may touch as allow_suspected asks: {listed}"
        return dataclasses.replace(geometry, allowed=allowed, suspected=suspected), [told]
    told = f"links touch where the robot may stand: {listed}; allow_suspected lets them"
    return dataclasses.replace(geometry, suspected=suspected), [told]


def dh_table(body: schema.RobotBody) -> DhTable | None:
    """The table a robot was given as; None for one that came as URDF.

    Raises:
        InvalidRobotDescription: The table is not valid, joint_limits names an unknown joint, or
            only some rows have a motor.
    """
    dh = body.dh
    if dh is None:
        return None
    names = [f"joint_{i}" for i in range(1, len(dh.rows) + 1)]
    robot_motors(body, names)
    limits, _ = robot_limits.joint_limits(body.joint_limits, names, names)
    for name in limits:
        if name not in (*names, ALL_JOINTS):
            raise InvalidRobotDescription(
                f"joint_limits names the joint {name!r}, which the table does not have",
                hint=f"Its joints are: {', '.join(names)}.",
                joint=name,
            )
    rows = (
        DhRow(**{**_row_values(row), **limits.get(ALL_JOINTS, {}), **limits.get(name, {})})
        for name, row in zip(names, dh.rows, strict=True)
    )
    return DhTable(
        dh.convention,
        tuple(rows),
        np.eye(4) if dh.base is None else poses.transform(dh.base),
        np.eye(4) if dh.tool is None else poses.transform(dh.tool),
        np.array(dh.gravity if dh.gravity is not None else GRAVITY),
    )


def joint_names(body: schema.RobotBody) -> tuple[str, ...]:
    """Names of the joints of the chain that a document describes.

    Raises:
        InvalidRobotDescription: The description is not valid.
    """
    if body.dh is not None:
        return tuple(f"joint_{i}" for i in range(1, len(body.dh.rows) + 1))
    semantics = None if body.srdf is None else parse_srdf(body.srdf)
    ends = (body.base_link, body.tip_link)
    return select(parse_urdf(body.urdf or ""), *ends, semantics=semantics).joints


def _row_values(row: schema.DhRow) -> dict[str, Any]:
    """Arguments of a row of the domain's table."""
    values = row.model_dump(exclude={"geometry", "continuous", "motor"})
    if row.motor is not None:
        values |= reflected(row.motor)
    return values | {"lower": -math.inf, "upper": math.inf} if row.continuous else values


def _from_dh(body: schema.RobotBody, table: DhTable) -> tuple[RobotGeometry, list[str]]:
    dh = body.dh
    assert dh is not None
    capsules = None if dh.geometry is None else dh.geometry.capsules
    geometry = dh_robot_geometry(body.name, table, _solids(dh), capsules)
    chain = geometry.chain
    if body.base_link not in (None, chain.base_link):
        raise InvalidRobotDescription(
            f"base_link {body.base_link!r}: the base of a DH table is {chain.base_link!r}",
            hint="Leave base_link out.",
        )
    if body.tip_link is not None:
        chain = dataclasses.replace(chain, tip_link=chain.link(body.tip_link).name)
    chain, lint = robot_limits.with_rules(chain, body.default_limits)
    return dataclasses.replace(geometry, chain=chain), [
        *poses.rounding_notes(dh, "dh"),
        *_range_lint(dh, chain),
        *lint,
    ]


def _range_lint(dh: schema.DhTable, chain: Chain) -> list[str]:
    """Joints of a table that lack a position limit and are not said to turn without end."""
    limits = chain.limits
    open_ended = np.isinf(limits.lower) | np.isinf(limits.upper)
    rows = zip(dh.rows, chain.joint_names, open_ended, strict=True)
    names = [name for row, name, is_open in rows if is_open and not row.continuous]
    if not names:
        return []
    joints = ", ".join(names)
    return [f"{joints} have no lower or no upper limit: give them where the range is not unlimited"]


def _solids(dh: schema.DhTable) -> list[list[LinkSolid]]:
    """The solids that each row of a table names."""
    return [
        [_solid(solid, f"dh.rows[{i}].geometry[{k}]") for k, solid in enumerate(row.geometry or ())]
        for i, row in enumerate(dh.rows)
    ]


def _solid(body: schema.LinkSolid, where: str) -> LinkSolid:
    with located(where, InvalidScene, kind=InvalidRobotDescription):
        shape = poses.shape(body.shape)
    return LinkSolid(shape, np.eye(4) if body.pose is None else poses.transform(body.pose))


def _limit_lint(chain: Chain) -> list[str]:
    lint = []
    for quantity in _NEEDED_TO_TIME:
        values: Array = getattr(chain.limits, quantity)
        missing = [chain.joint_names[int(i)] for i in np.flatnonzero(np.isnan(values))]
        if missing:
            lint.append(
                f"no {quantity} limit is known for {', '.join(missing)}: plans need it, give it "
                "in joint_limits"
            )
    return lint


def _mass_lint(chain: Chain) -> list[str]:
    """Joints that carry massless links in a robot that has inertias."""
    massless = massless_joints(chain)
    if not massless or len(massless) == chain.n:
        return []
    joints = ", ".join(chain.joint_names[i] for i in massless)
    lint = [f"the links of {joints} have no inertia: they are massless in the dynamics"]
    names = joints_without_inertia(chain)
    if names:
        lint.append(
            f"nothing at or beyond {', '.join(names)} has an inertia: forward dynamics and "
            "simulation need one there, or a motor inertia"
        )
    return lint


# ------------------------------------------------------------------------------------ back


def robot_answer(
    geometry: RobotGeometry,
    lint: list[str],
    name: str,
    *,
    is_built_in: bool,
    body: schema.RobotBody | None = None,
) -> schema.RobotAnswer:
    """A robot as answers give it, with the DH table it was given as or one that fits its axes.

    Args:
        geometry: The robot.
        lint: Oddities of the robot, as sentences.
        name: Name of the robot.
        is_built_in: Whether the robot comes with the app.
        body: The request that stored it.
    """
    chain = geometry.chain
    motors = None if body is None else robot_motors(body, chain.joint_names)
    dh, more = _dh_answer(chain, body, list((motors or {}).values()))
    limits = {
        item.name: [_finite(value) for value in getattr(chain.limits, item.name)]
        for item in dataclasses.fields(chain.limits)
    }
    return schema.RobotAnswer(
        name=name,
        built_in=is_built_in,
        hash=geometry.content_hash,
        joint_names=list(chain.joint_names),
        joint_types=[_type(kind) for kind in chain.joint_types],
        limits=schema.Limits(**limits),
        links=[link.name for link in chain.links],
        frame=chain.root_link,
        **picked(chain, "base_link", "tip_link"),
        states={name: q.tolist() for name, q in geometry.states.items()},
        default_limits=None if body is None else body.default_limits,
        held=None if body is None else body.held,
        inertias=None if body is None else body.inertias,
        calibration=None if body is None else body.calibration,
        fingers=_finger_joints(geometry),
        tools=[] if body is None else [item.name for item in body.tools or ()],
        motors=motors,
        dh=dh,
        wrist=classify_wrist(chain),
        allowed_collisions=[list(pair) for pair in geometry.allowed],
        allowed_collision_reasons=list(geometry.allowed.values()),
        suspected_collisions=[
            schema.SuspectedPair(pair=list(pair), reason=reason)
            for pair, reason in geometry.suspected.items()
        ],
        lint=tidy([*lint, *more]),
    )


def _finger_joints(geometry: RobotGeometry) -> dict[str, schema.FingerJoint]:
    """Joints of the gripper that lead, with where the robot holds them."""
    limits = {name: geometry.fingers.limits(name) for name in geometry.fingers.positions}
    return {
        name: schema.FingerJoint(
            position=at, lower=_finite(limits[name].lower), upper=_finite(limits[name].upper)
        )
        for name, at in geometry.fingers.positions.items()
    }


def _dh_answer(
    chain: Chain, body: schema.RobotBody | None, motors: Sequence[Motor]
) -> tuple[schema.DhAnswer | None, list[str]]:
    """The table of a robot as answers give it, and why there is none.

    Args:
        chain: The robot.
        body: The request that stored it.
        motors: One for each joint, or none.
    """
    given = None if body is None else body.dh
    try:
        table = (None if body is None else dh_table(body)) or dh_from_chain(chain)
    except InvalidRobotDescription as error:
        return None, [f"no DH table: {error.message}"]
    solids = [None] * len(table.rows) if given is None else [row.geometry for row in given.rows]
    drives: list[Motor | None] = [*motors] or [None] * len(table.rows)
    rows = [_row_answer(*parts) for parts in zip(table.rows, solids, drives, strict=True)]
    answer = schema.DhAnswer(
        convention=table.convention,
        rows=rows,
        base=poses.pose_answer(table.base),
        tool=poses.pose_answer(table.tool),
        gravity=table.gravity.tolist(),
        geometry=None if given is None else given.geometry,
    )
    return answer, []


def _row_answer(
    row: DhRow, geometry: list[schema.LinkSolid] | None, motor: Motor | None
) -> schema.DhRowAnswer:
    """A row as answers give it, which a request may send as it is.

    Args:
        row: The row; with a motor its motor_inertia and viscous_friction are the motor's.
        geometry: Solids of the link behind the joint.
        motor: Motor that drives the joint.
    """
    optional = ("lower", "upper", "velocity", "acceleration", "jerk", "effort")
    values = {name: getattr(row, name) for name in optional}
    center, inertia = (
        None if rows is None else np.asarray(rows).tolist()
        for rows in (row.center_of_mass, row.inertia)
    )
    return schema.DhRowAnswer(
        **picked(row, "type", "a", "alpha", "d", "theta", "beta"),
        **{name: None if value is None else _finite(value) for name, value in values.items()},
        mass=row.mass,
        center_of_mass=center,
        inertia=inertia,
        motor_inertia=row.motor_inertia if motor is None else None,
        viscous_friction=row.viscous_friction if motor is None else None,
        motor=motor,
        coulomb_friction=row.coulomb_friction,
        continuous=row.lower == -math.inf and row.upper == math.inf,
        geometry=geometry,
    )


def _type(kind: int) -> Literal["revolute", "prismatic"]:
    return "prismatic" if kind == JointType.PRISMATIC else "revolute"


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
