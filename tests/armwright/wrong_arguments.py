"""A program that gives every public function and method arguments that are none of its own.

It prints JSON: what was answered, what raised another error than those that tell callers what is
wrong, and public names without a right call here. Whoever runs it sees an abort.
"""

import inspect
import json
import sys
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

import armwright as aw

Q, GOAL = np.array([0.1, 0.2]), np.array([0.4, 0.3])
ROBOT = aw.load_robot("planar_rr")
CHAIN = ROBOT.chain
BALL = aw.Obstacle("ball", aw.Sphere(0.1), aw.pose([0.5, 0.0, 3.0]))
SCENE = aw.Scene([BALL])
T = aw.fk(ROBOT, GOAL)
MOTION = aw.retime(np.stack([Q, GOAL]), ROBOT).trajectory
HELD = aw.Attachment(BALL, "link_2")
TOLERANCE = aw.ToolTolerance(-np.full(6, 0.01), np.full(6, 0.01))
SEAM = aw.SeamOptions((aw.SeamWaypoint(T), aw.SeamWaypoint(aw.fk(ROBOT, GOAL + 0.1))), TOLERANCE)
CUBE = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
FACES = np.array([[0, 1, 2], [0, 1, 4], [0, 2, 4], [1, 2, 4]])


class Call(NamedTuple):
    """A right call.

    Args:
        function: Of a name: a function, a method or a class.
        arguments: That it takes.
        any_shape: Arguments of which arrays of other lengths or dimensions are right as well.
        any_value: Arguments of which any value of the type is right, infinities included.
    """

    function: Callable[..., Any]
    arguments: dict[str, Any]
    any_shape: tuple[str, ...] = ()
    any_value: tuple[str, ...] = ()


def calls() -> dict[str, Call]:
    """Right calls of public functions and classes, and of their methods, by name."""
    return {**functions(), **shapes(), **options(), **methods()}


def functions() -> dict[str, Call]:
    """Of functions."""
    cell, q = {"robot": ROBOT, "scene": SCENE}, {"robot": ROBOT, "joints": Q}
    states = "joints", "velocities", "accelerations"
    written = {"trajectory": MOTION, "options": aw.ExportOptions(aw.ExportFormat.CSV)}
    loop = {"controller": aw.PdGravity(CHAIN, Q, Q), "trajectory": MOTION}
    box = {"robot": ROBOT, "limits": {"velocity": np.ones(2), "acceleration": np.ones(2)}}
    return {
        "certify": Call(aw.certify, cell | {"trajectory": MOTION, "margin": 0.01}),
        "check": Call(aw.check, cell | {"joints": Q, "margin": 0.01}),
        "dynamics": Call(aw.dynamics, q | {"velocities": Q}, states),
        "equations": Call(aw.equations, {"robot": ROBOT, "notation": "text"}),
        "export": Call(aw.export, cell | written | {"margin": 0.01}),
        "fk": Call(aw.fk, q | {"link": "link_2"}, states),
        "grasp": Call(aw.grasp, cell | {"name": "ball", "link": "link_2", "q": Q}),
        "grasp_region": Call(
            aw.grasp_region, {"T_object_tool": T, "axis": [0.0, 0.0, 1.0], "angles": (0.0, 1.0)}
        ),
        "hold": Call(aw.hold, cell | {"attachments": [HELD]}),
        "ik": Call(aw.ik, {"robot": ROBOT, "T_base_link": T, "link": "link_2", "seed_joints": Q}),
        "inverse_dynamics": Call(
            aw.inverse_dynamics, q | {"velocities": Q, "accelerations": Q}, states
        ),
        "jacobian": Call(aw.jacobian, q | {"link": "link_2"}, states),
        "place": Call(aw.place, {"scene": aw.Scene([_in_tool()]), "chain": CHAIN, "joints": Q}),
        "place_base": Call(aw.place_base, cell | {"poses": T[None], "bases": np.eye(4)[None]}),
        "place_region": Call(
            aw.place_region,
            {"T_reference_object": T, "size": (0.1, 0.1), "angles": (0.0, 1.0)},
        ),
        "plan": Call(aw.plan, cell | {"start": Q, "goal": GOAL, "margin": 0.01}),
        "plan_seam": Call(aw.plan_seam, cell | {"start": Q, "seam": SEAM, "margin": 0.01}),
        "pose": Call(aw.pose, {"position": Q[[0, 1, 0]], "quaternion_xyzw": np.eye(4)[3]}),
        "quadratic_lyapunov": Call(aw.quadratic_lyapunov, {"A": -np.eye(2), "P": np.eye(2)}),
        "reach": Call(aw.reach, cell | {"poses": T[None], "link": "link_2"}),
        "release": Call(
            aw.release, {"robot": ROBOT, "scene": aw.Scene(), "attachment": HELD, "q": Q}
        ),
        "retime": Call(aw.retime, box | {"waypoints": np.stack([Q, GOAL])}, any_value=("limits",)),
        "retime_states": Call(
            aw.retime_states,
            {"start": aw.JointState(Q), "end": aw.JointState(GOAL), "robot": ROBOT},
        ),
        "scene_from_moveit": Call(aw.scene_from_moveit, {"text": "name: s\nworld: {}\n"}),
        "simulate": Call(aw.simulate, loop | {"initial_position": Q, "initial_velocity": 0.0 * Q}),
        "solve_lyapunov": Call(aw.solve_lyapunov, {"A": -np.eye(2), "Q": np.eye(2)}),
        "swept_volume": Call(
            aw.swept_volume, {"motion": MOTION, "robot": ROBOT, "tolerance": 0.05}
        ),
    }


def _in_tool() -> aw.Obstacle:
    return aw.Obstacle("cup", aw.Sphere(0.1), aw.pose([0.0, 0.0, 1.0]), frame="tool")


def shapes() -> dict[str, Call]:
    """Of shapes, obstacles and other values of geometry."""
    return {
        "Box": Call(aw.Box, {"size": np.ones(3)}),
        "Capsule": Call(aw.Capsule, {"radius": 1.0, "height": 1.0}),
        "Cone": Call(aw.Cone, {"radius": 1.0, "height": 1.0}),
        "Convex": Call(aw.Convex, {"vertices": CUBE}, ("vertices",)),
        "Cylinder": Call(aw.Cylinder, {"radius": 1.0, "height": 1.0}),
        "HalfSpace": Call(
            aw.HalfSpace, {"normal": np.eye(3)[0], "offset": 1.0}, (), ("offset",)
        ),
        "Mesh": Call(aw.Mesh, {"vertices": CUBE, "faces": FACES}, ("vertices", "faces")),
        "PointCloud": Call(aw.PointCloud, {"points": CUBE, "radius": 1.0}, ("points",)),
        "Sphere": Call(aw.Sphere, {"radius": 1.0}),
        "Obstacle": Call(
            aw.Obstacle,
            {"id": "a", "shape": aw.Sphere(1.0), "T_world_obstacle": T, "margin": 0.1},
            any_value=("id",),
        ),
        "Trajectory": Call(
            aw.Trajectory,
            {"joint_names": ("a", "b"), "breaks": np.array([0.0, 1.0]),
             "coefficients": np.ones((1, 2, 3))},
            ("coefficients",),
        ),
        "BoxRegion": Call(aw.BoxRegion, {"T": T, "size": np.ones(3)}, any_value=("size",)),
        "PoseGrid": Call(
            aw.PoseGrid,
            {"size": np.ones(3), "spacing": 0.5, "T_base_box": T, "rotations": np.eye(3)[None]},
            ("rotations",),
        ),
    }  # fmt: skip


def options() -> dict[str, Call]:
    """Of goals, limits and options."""
    return {
        "JointState": Call(aw.JointState, {"position": Q, "velocity": Q}),
        "PoseGoal": Call(
            aw.PoseGoal,
            {"T_base_tip": T, "position_tolerance": 0.1, "orientation_tolerance": 0.1},
        ),
        "Problem": Call(
            aw.Problem,
            {"robot": ROBOT, "scene": SCENE, "start": Q, "goals": (aw.JointGoal(GOAL),),
             "margin": 0.1},
        ),
        "ToolTolerance": Call(
            aw.ToolTolerance, {"lower": -np.full(6, 0.01), "upper": np.full(6, 0.01)}
        ),
    }  # fmt: skip


def methods() -> dict[str, Call]:
    """Of methods that take numbers."""
    checker = aw.Checker.of(ROBOT, SCENE)
    ends = {"start": Q, "end": GOAL}
    states = np.stack([Q, GOAL])
    corners = {
        "waypoints": np.stack([Q, GOAL, Q]), "reaches": np.full(1, 0.01),
        "halvings": 1, "keep": False, "smooth": True,
    }  # fmt: skip
    return {
        "Checker.of": Call(aw.Checker.of, {"robot": ROBOT, "scene": SCENE, "margin": 0.1}),
        "Checker.all_valid": Call(checker.all_valid, {"states": states}),
        "Checker.bracket": Call(checker.bracket, {"q": Q}),
        "Checker.clearance": Call(checker.clearance, {"q": Q}),
        "Checker.closest": Call(
            checker.closest, {"states": states, "within": 1.0}, (), ("within",)
        ),
        "Checker.curve": Call(checker.curve, {"b0": Q, "b1": Q, "b2": Q, "b3": Q}),
        "Checker.each_valid": Call(checker.each_valid, {"states": states}),
        "Checker.free": Call(checker.free, ends),
        "Checker.gradient": Call(checker.gradient, {"q": Q, "within": 1.0}, (), ("within",)),
        "Checker.least_overlap": Call(checker.least_overlap, {"states": states}),
        "Checker.polyline": Call(checker.polyline, {"waypoints": states}),
        "Checker.round_corners": Call(
            lambda **given: list(checker.round_corners(**given)), corners
        ),
        "Checker.segment": Call(checker.segment, ends),
        "Checker.straight": Call(checker.straight, ends),
        "Checker.valid": Call(checker.valid, {"q": Q}),
        "Chain.configuration": Call(CHAIN.configuration, {"q": Q}, ("q",)),
        "Chain.link": Call(CHAIN.link, {"name": "link_2"}),
        "Scene.obstacle": Call(SCENE.obstacle, {"name": "ball"}),
        "Trajectory.derivative": Call(MOTION.derivative, {"order": 1}),
        "Trajectory.dilate": Call(MOTION.dilate, {"factor": 2.0}),
        "Trajectory.extrema": Call(MOTION.extrema, {"derivative": 1}),
        "Trajectory.jumps": Call(MOTION.jumps, {"derivative": 1}),
        "Trajectory.peaks": Call(MOTION.peaks, {"derivative": 1}),
        "Trajectory.piece_extrema": Call(MOTION.piece_extrema, {"derivative": 1}),
        "Trajectory.sample": Call(
            MOTION.sample, {"times": np.array([0.0, 0.1]), "derivative": 1}, ("times",)
        ),
        "Trajectory.split": Call(MOTION.split, {"time": 0.1}),
        "Trajectory.uniform_samples": Call(MOTION.uniform_samples, {"period": 0.1}),
    }


def wrong(value: Any, call: Call, name: str) -> Iterator[tuple[str, Any]]:
    """Values that are none in place of a right one, each with a word for it."""
    if isinstance(value, bool):
        return
    yield "None", None
    if name not in call.any_value or not isinstance(value, str):
        yield "text", "nonsense"
    if isinstance(value, np.ndarray):
        if name not in call.any_shape:
            yield "one more", np.concatenate([value, value[..., :1]], axis=-1)
            yield "one less", value[..., :-1]
            yield "many more", np.concatenate([value] * 500, axis=-1)
            yield "empty", value[..., :0]
            yield "two dimensions more", value[None, None]
        yield "a number", 0.5
        yield "strings", np.full(value.shape, "a")
        yield "ragged", [[1.0], [1.0, 2.0]]
        if name not in call.any_value:
            yield "not a number", np.full(value.shape, np.nan)
            yield "infinite", np.full(value.shape, np.inf)
    elif isinstance(value, float):
        yield "not a number", np.nan
        yield "a list", [value]
        if name not in call.any_value:
            yield "negative", -0.5
            yield "infinite", np.inf
    elif not isinstance(value, str):
        yield "a number", 0.5
    else:
        yield "a number", 3


def told(error: Exception) -> bool:
    """Whether an error is one of those that tell callers what is wrong."""
    return isinstance(error, aw.ArmwrightError | TypeError)


def named() -> set[str]:
    """Public functions, and classes whose constructor or methods read arrays in kernels."""
    found = set()
    for name in aw.__all__:
        one = getattr(aw, name)
        if inspect.isfunction(one):
            found.add(name)
    for cls in (aw.Checker, aw.Trajectory):
        for name, method in inspect.getmembers(cls):
            takes = callable(method) and not name.startswith("_")
            if takes and set(inspect.signature(method).parameters) - {"self"}:
                found.add(f"{cls.__name__}.{name}")
    return found


def main() -> None:
    """Call everything."""
    known, failures, count = calls(), [], 0
    for name, call in known.items():
        if len(sys.argv) > 1 and sys.argv[1] not in name:
            continue
        sys.stderr.write(f"{name}\n")  # the last line says where it ended
        sys.stderr.flush()
        call.function(**call.arguments)
        for argument, value in call.arguments.items():
            for word, other in wrong(value, call, argument):
                if other is None and _may_be_none(call.function, argument):
                    continue
                count += 1
                try:
                    call.function(**call.arguments | {argument: other})
                except Exception as error:  # noqa: BLE001  any but two is a failure
                    if not told(error):
                        failures.append([name, argument, word, repr(error)[:200]])
                else:
                    failures.append([name, argument, word, "answered"])
    missing = sorted(
        named() - known.keys() - {"builtin_names", "load_robot", "plan_task", "plan_tour"}
    )
    sys.stdout.write(json.dumps({"count": count, "failures": failures, "missing": missing}))


def _may_be_none(function: Callable[..., Any], argument: str) -> bool:
    parameter = inspect.signature(function).parameters.get(argument)
    return parameter is None or "None" in str(parameter.annotation) or parameter.default is None


if __name__ == "__main__":
    main()
