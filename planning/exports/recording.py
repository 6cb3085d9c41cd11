"""Recording of motions as MCAP: robot, scene, motion and clearance on one clock.

Messages are JSON, with schemas whose names viewers such as Foxglove know: the 3D panel draws links
and obstacles, plots take joints and clearance. The clock begins at 0 with the motion.
"""

import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from kinematics.arrays import Array, typed
from kinematics.errors import InvalidOption
from kinematics.forward import link_poses
from kinematics.model.chain import Chain
from kinematics.pose import inverse, to_quaternions
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.fcl_distance import FclWorld
from obstacles.convex.piece import Piece
from obstacles.convex.triangles import join, piece_triangles
from obstacles.robots.finger_geometry import with_fingers
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.exports.export import Place
from planning.exports.program import ProgramPart
from planning.proof.certificate import Certificate

#: Instants that are recorded at most; clearance is measured at fewer, in some seconds.
_MOST, _CLEARANCES = 20_000, 301
#: Times that are no further apart are the same [s].
_SAME = 1e-9
#: Positions of moving fingers that are drawn, at most.
_FINGER_SHAPES = 10
_LINK, _HELD, _OBSTACLE = (0.8, 0.8, 0.82, 1.0), (0.9, 0.6, 0.2, 1.0), (0.35, 0.5, 0.75, 0.9)
_WHOLE, _NUMBER, _TEXT = {"type": "integer"}, {"type": "number"}, {"type": "string"}


def _object(**properties: Any) -> dict[str, Any]:
    return {"type": "object", "properties": properties}


def _list(items: Mapping[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": items}


_TIME = _object(sec=_WHOLE, nsec=_WHOLE)
_POINT = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_TRIANGLES = _object(
    pose=_object(position=_POINT, orientation=_QUATERNION),
    points=_list(_POINT),
    color=_object(r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER),
    colors=_list({"type": "object"}),
    indices=_list(_WHOLE),
)
_LISTS = ("metadata", "arrows", "cubes", "spheres", "cylinders", "lines", "texts", "models")
_ENTITY = _object(
    timestamp=_TIME,
    frame_id=_TEXT,
    id=_TEXT,
    lifetime=_TIME,
    frame_locked={"type": "boolean"},
    triangles=_list(_TRIANGLES),
    **{name: _list({"type": "object"}) for name in _LISTS},
)
_JOINT = _object(name=_TEXT, position=_NUMBER, velocity=_NUMBER, acceleration=_NUMBER)
_TRANSFORM = _object(
    timestamp=_TIME, parent_frame_id=_TEXT, child_frame_id=_TEXT, translation=_POINT,
    rotation=_QUATERNION,
)  # fmt: skip
_DELETION = _object(timestamp=_TIME, type=_WHOLE, id=_TEXT)
_SCENE_UPDATE = _object(deletions=_list(_DELETION), entities=_list(_ENTITY))
#: Topics with the names and the forms of their messages.
_TOPICS = {
    "/robot": ("foxglove.SceneUpdate", _SCENE_UPDATE),
    "/scene": ("foxglove.SceneUpdate", _SCENE_UPDATE),
    "/certificate": (
        "foxglove.Log",
        _object(timestamp=_TIME, level=_WHOLE, message=_TEXT, name=_TEXT, file=_TEXT, line=_WHOLE),
    ),
    "/tf": ("foxglove.FrameTransforms", _object(transforms=_list(_TRANSFORM))),
    "/joint_states": ("foxglove.JointStates", _object(timestamp=_TIME, joints=_list(_JOINT))),
    "/clearance": (
        "armwright.Clearance",
        _object(timestamp=_TIME, distance=_NUMBER, pair=_list(_TEXT), points=_list(_POINT)),
    ),
}


@typed
def record(
    trajectory: Trajectory,
    robot: RobotGeometry,
    scene: Scene,
    certificate: Certificate | None = None,
    *,
    sample_period: float = 0.01,
) -> bytes:
    """The content of an MCAP file that shows a motion among its obstacles.

    Args:
        trajectory: Trajectory of all joints of the robot, in its order.
        robot: The arm with its geometry and what it holds.
        scene: The obstacles.
        certificate: Certificate of the motion, which is told in words.
        sample_period: Time between instants; the end is one more [s].

    Raises:
        InvalidOption: The period is not positive, or asks for too many instants.
    """
    place = Place(robot, scene, 0.0)
    part = ProgramPart("motion", "motion", trajectory, place)
    return record_parts([part], [certificate], sample_period=sample_period)


def record_parts(
    parts: Sequence[ProgramPart],
    certificates: Sequence[Certificate | None],
    *,
    sample_period: float = 0.01,
) -> bytes:
    """The content of an MCAP file that shows motions one after the other, with what is held.

    Args:
        parts: Motions and what the cell does between them; each begins where the one before ends.
        certificates: Certificate of each, which is told in words.
        sample_period: Time between instants; the end is one more [s].

    Raises:
        InvalidOption: The period is not positive, or asks for too many instants.
    """
    from mcap.writer import Writer  # noqa: PLC0415  seldom needed

    duration = sum(part.motion.duration for part in parts)
    if not sample_period > 0.0 or duration / sample_period > _MOST:
        raise InvalidOption(
            f"sample_period: {sample_period:g} s does not fit {duration:g} s",
            hint=f"At most {_MOST} instants are recorded, from a positive period.",
        )
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start(library="armwright")
    channels = {}
    for topic, (name, form) in _TOPICS.items():
        content = json.dumps({"title": name} | form).encode()
        schema = writer.register_schema(name, "jsonschema", content)
        channels[topic] = writer.register_channel(topic, "json", schema)
    for topic, time, message in _messages(parts, certificates, sample_period, duration):
        nanoseconds = round(time * 1e9)
        content = json.dumps(message, allow_nan=False).encode()
        writer.add_message(channels[topic], nanoseconds, content, nanoseconds)
    writer.finish()  # type: ignore[no-untyped-call]
    return stream.getvalue()


def _messages(
    parts: Sequence[ProgramPart],
    certificates: Sequence[Certificate | None],
    period: float,
    duration: float,
) -> Iterator[tuple[str, float, dict[str, Any]]]:
    """Topics, times [s] and messages of a recording."""
    begin, before = 0.0, dict[str, str]()
    step = max(1, math.ceil(duration / period / _CLEARANCES))
    for k, (part, certificate) in enumerate(zip(parts, certificates, strict=True)):
        if certificate is not None:
            label = part.label if len(parts) > 1 else "armwright"
            yield "/certificate", begin, _statement(certificate, label, begin)
        length = part.motion.duration
        times = np.arange(0.0, length, period)
        times = times[times < length - _SAME]
        if k == len(parts) - 1:  # the last instant of others is the first of the next
            times = np.append(times, length)
        for arm, some in _shapes(part, times):
            for topic, value in (("/robot", arm), ("/scene", part.place.scene)):
                if before.get(topic) != value.content_hash:
                    time = begin + (some[0] if len(some) else 0.0)
                    yield topic, time, _update(_entities(arm, value), time, topic in before)
                    before[topic] = value.content_hash
            yield from _instants(part.motion, arm, part.place.scene, begin, some, step)
        begin += length


def _shapes(part: ProgramPart, times: Array) -> Iterator[tuple[RobotGeometry, Array]]:
    """The robot with its fingers as they stand, and the times [s] for which it is drawn so."""
    moving, arm = part.fingers, part.place.robot
    if moving is None:
        yield arm, times
        return
    for some in np.array_split(times, max(1, min(len(times), _FINGER_SHAPES))):
        values = moving.trajectory.sample(some[:1])[0].tolist() if len(some) else []
        stand = {n: at for n, at in zip(moving.names, values, strict=False) if n in moving.leaders}
        yield with_fingers(arm, stand), some


def _instants(
    motion: Trajectory, robot: RobotGeometry, scene: Scene, begin: float, times: Array, step: int
) -> Iterator[tuple[str, float, dict[str, Any]]]:
    """Frames, joints and clearance at times of a part that begins at a time [s]."""
    if not len(times):
        return
    chain = robot.chain
    poses = link_poses(chain, motion.sample(times))
    turns = to_quaternions(poses[..., :3, :3])
    states = np.stack([motion.sample(times, order) for order in range(3)], axis=-1)
    world = FclWorld(robot, scene)
    for k, time in enumerate((begin + times).tolist()):
        stamp = _stamp(time)
        transforms = [
            {
                "timestamp": stamp,
                "parent_frame_id": chain.root_link,
                "child_frame_id": link.name,
                "translation": _xyz(poses[k, i, :3, 3]),
                "rotation": _xyz(turns[k, i]),
            }
            for i, link in enumerate(chain.links)
            if link.name != chain.root_link
        ]
        yield "/tf", time, {"transforms": transforms}
        rates = ("position", "velocity", "acceleration")
        joints = [
            {"name": name} | dict(zip(rates, row, strict=True))
            for name, row in zip(chain.joint_names, states[k].tolist(), strict=True)
        ]
        yield "/joint_states", time, {"timestamp": stamp, "joints": joints}
        if k % step == 0 or k == len(times) - 1:
            near = world.nearest_points(states[k, :, 0])
            if near.pair is not None:
                points = [] if near.points is None else [_xyz(point) for point in near.points]
                told = {"distance": near.distance, "pair": list(near.pair), "points": points}
                yield "/clearance", time, {"timestamp": stamp} | told


def _entities(robot: RobotGeometry, value: RobotGeometry | Scene) -> list[dict[str, Any]]:
    if isinstance(value, RobotGeometry):
        return [*_links(value)]
    root = robot.chain.root_link
    return [_entity(root, item.id, item.pieces(), np.eye(4), _OBSTACLE) for item in value.obstacles]


def _update(entities: list[dict[str, Any]], time: float, again: bool) -> dict[str, Any]:
    """All that there is from a time [s] on, in place of what was there before."""
    stamp = _stamp(time)
    everything = {"timestamp": stamp, "type": 1, "id": ""}
    stamped = [entity | {"timestamp": stamp} for entity in entities]
    return {"deletions": [everything] if again else [], "entities": stamped}


def _links(robot: RobotGeometry) -> Iterator[dict[str, Any]]:
    """Solids of links and of what is held, in the frame of a link that moves with them."""
    carriers = _carriers(robot.chain)
    parts: dict[tuple[str, int], list[Piece]] = {}
    for piece, name, joint in zip(robot.pieces, robot.links, robot.joints.tolist(), strict=True):
        parts.setdefault((name, joint), []).append(piece)
    for (name, joint), pieces in parts.items():
        is_link = name in robot.chain.index
        link = robot.chain.link(name) if is_link else None
        if link is None or link.joint != joint:
            link = robot.chain.link(carriers[joint])
        color = _LINK if is_link else _HELD
        yield _entity(link.name, f"{name}/{joint}", pieces, inverse(link.T_joint_link), color)


def _carriers(chain: Chain) -> dict[int, str]:
    """A link that moves with each joint; -1 is the base."""
    return {link.joint: link.name for link in reversed(chain.links)}


def _entity(
    frame: str, name: str, pieces: Any, T: Array, color: tuple[float, ...]
) -> dict[str, Any]:
    surface = join(piece_triangles(piece) for piece in pieces)
    triangles = {
        "pose": {"position": _xyz(T[:3, 3]), "orientation": _xyz(to_quaternions(T[:3, :3]))},
        "points": [_xyz(point) for point in np.round(surface.vertices, 6)],
        "color": dict(zip("rgba", color, strict=True)),
        "colors": [],
        "indices": surface.faces.ravel().tolist(),
    }
    rest: dict[str, Any] = {key: [] for key in _LISTS}
    return rest | {
        "frame_id": frame,
        "id": name,
        "lifetime": _stamp(0.0),
        "frame_locked": True,
        "triangles": [triangles],
    }


def _statement(certificate: Certificate, label: str, time: float) -> dict[str, Any]:
    verdict = "Proved for every instant" if certificate.verified else "Not proved"
    text = f"{verdict}, {certificate.premises.against()}."
    if np.isfinite(certificate.min_clearance):
        text += f" Clearance at least {certificate.min_clearance:.6g} m."
    text += "".join(f" {reason}" for reason in certificate.proved.reasons)
    return {
        "timestamp": _stamp(time), "level": 2 if certificate.verified else 4, "message": text,
        "name": label, "file": "", "line": 0,
    }  # fmt: skip


def _stamp(time: float) -> dict[str, int]:
    seconds, rest = divmod(round(time * 1e9), 1_000_000_000)
    return {"sec": seconds, "nsec": rest}


def _xyz(values: Array) -> dict[str, float]:
    return dict(zip("xyzw"[: len(values)], values.tolist(), strict=True))
