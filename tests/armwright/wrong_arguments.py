"""A program that gives every public function and method arguments that are none of its own.

Right arguments come from signatures: a parameter's name tells its value. It prints JSON: how often
it called, what was answered, what raised another error than those that tell callers what is wrong,
and public names without a right call here. Whoever runs it sees an abort.
"""

import inspect
import json
import sys
from collections.abc import Callable, Iterator
from typing import Any, cast

import numpy as np

import armwright as aw

Q, GOAL = np.array([0.1, 0.2]), np.array([0.4, 0.3])
STATES = np.stack([Q, GOAL])
ROBOT = aw.load_robot("planar_rr")
CHAIN = ROBOT.chain
BALL = aw.Obstacle("ball", aw.Sphere(0.1), aw.pose([0.5, 0.0, 3.0]))
CUP = aw.Obstacle("cup", aw.Sphere(0.1), aw.pose([0.0, 0.0, 1.0]), frame="tool")
SCENE = aw.Scene([BALL])
T = aw.fk(ROBOT, GOAL)
MOTION = aw.retime(STATES, ROBOT).trajectory
PLAN = cast(aw.Plan, aw.plan(ROBOT, aw.Scene(), Q, GOAL))
HELD = aw.Attachment(BALL, "link_2")
TOLERANCE = aw.ToolTolerance(-np.full(6, 0.01), np.full(6, 0.01))
SEAM = aw.SeamOptions((aw.SeamWaypoint(T), aw.SeamWaypoint(aw.fk(ROBOT, GOAL + 0.1))), TOLERANCE)
CUBE = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
FACES = np.array([[0, 1, 2], [0, 1, 4], [0, 2, 4], [1, 2, 4]])

TIMES = np.linspace(0.0, 1.0, 40)
WAVES = np.sin(np.outer(TIMES, [5.0, 7.0]))
LOG = aw.Log(WAVES, aw.inverse_dynamics(ROBOT, WAVES, 0.0 * WAVES, 0.0 * WAVES))

#: Right values of parameters, by their names; those that begin with T are poses.
RIGHT: dict[str, Any] = {
    "A": -np.eye(2), "P": np.eye(2), "Q": np.eye(2), "T": T,
    "accelerations": Q, "attachment": HELD, "attachments": [HELD], "angles": (0.0, 1.0),
    "axis": [0.0, 0.0, 1.0], "b0": Q, "b1": Q, "b2": Q, "b3": Q, "bases": np.eye(4)[None],
    "breaks": np.array([0.0, 1.0]), "chain": CHAIN, "coefficients": np.ones((1, 2, 3)),
    "derivative": 1, "end": GOAL, "faces": FACES, "factor": 2.0, "goal": GOAL,
    "goals": (aw.JointGoal(GOAL),), "height": 1.0, "id": "a", "initial_position": Q,
    "initial_velocity": 0.0 * Q, "joint_names": ("a", "b"), "joints": Q, "link": "link_2",
    "lower": -np.full(6, 0.01), "margin": 0.01, "motion": MOTION, "name": "ball",
    "certificate": PLAN.certificate, "normal": np.eye(3)[0], "notation": "text", "offset": 1.0,
    "order": 1,
    "orientation_tolerance": 0.1, "period": 0.1, "points": CUBE, "poses": T[None], "position": Q,
    "position_tolerance": 0.1, "q": Q, "quaternion_xyzw": np.eye(4)[3], "radius": 1.0,
    "robot": ROBOT, "rotations": np.eye(3)[None], "scene": SCENE, "seam": SEAM,
    "seed_joints": Q, "shape": aw.Sphere(1.0), "size": np.ones(3), "spacing": 0.5, "start": Q,
    "states": STATES, "text": "name: s\nworld: {}\n", "time": 0.1, "times": np.array([0.0, 0.1]),
    "down": -np.eye(3)[2], "search": aw.GraspSearch("top"),
    "span": aw.JawSpan(np.eye(3)[0], 0.5), "form": "torch", "tcp": "tip", "tolerance": 0.05,
    "tool": aw.built_in_tool("torch", "torch_a"), "trajectory": MOTION,
    "upper": np.full(6, 0.01), "velocities": Q,
    "velocity": Q, "vertices": CUBE, "waypoints": STATES, "within": 1.0,
}  # fmt: skip
#: Right values where the name tells another one, or none.
OWN: dict[str, dict[str, Any]] = {
    "Chain.link": {"name": "link_2"},
    "Checker.round_corners": {
        "waypoints": np.stack([Q, GOAL, Q]), "reaches": np.full(1, 0.01), "halvings": 1,
        "keep": False, "smooth": True,
    },
    "calibrate": {
        "joints": WAVES, "measured": aw.Measured(points=aw.fk(ROBOT, WAVES, "link_2")[:, :3, 3]),
        "tolerance": (1e-3, 1e-3),
    },
    "certify_stops": {"plan": PLAN},
    "export": {"options": aw.ExportOptions(aw.ExportFormat.CSV)},
    "fit_motion": {"times": TIMES, "positions": WAVES, "joint_names": CHAIN.joint_names},
    "identify": {"logs": LOG},
    "identify_payload": {"logs": LOG},
    "place": {"scene": aw.Scene([CUP])},
    "place_region": {"size": (0.1, 0.1)},
    "pose": {"position": Q[[0, 1, 0]]},
    "release": {"scene": aw.Scene()},
    "retime": {"limits": {"velocity": np.ones(2), "acceleration": np.ones(2)}},
    "retime_states": {"start": aw.JointState(Q), "end": aw.JointState(GOAL)},
    "stop": {"plan": PLAN, "at": 0.1},
    "view": {"plan": PLAN},
    "simulate": {"controller": aw.PdGravity(CHAIN, Q, Q)},
}  # fmt: skip
#: Arguments that are left out, though they have a value.
LEFT_OUT = {"Chain.configuration": {"name"}, "simulate": {"robot"}}
CLASSES = (
    "Box", "BoxRegion", "Capsule", "Cone", "Convex", "Cylinder", "HalfSpace", "JointState", "Mesh",
    "Obstacle", "PointCloud", "PoseGoal", "PoseGrid", "Problem", "Sphere", "ToolTolerance",
    "Trajectory",
)  # fmt: skip
#: Functions that nothing wrong is given to: what they take is tested where it is read.
ELSEWHERE = {
    "jaw_span", "builtin_names", "export_program", "load_robot", "plan_task", "plan_tour",
    "plan_work", "program_parts", "read_recording", "regrasp", "resting_places", "with_fingers",
}  # fmt: skip
#: Arguments of which arrays of other lengths or dimensions are right as well.
ANY_SHAPE = {
    "Chain.configuration": {"q"}, "Convex": {"vertices"}, "Mesh": {"vertices", "faces"},
    "PointCloud": {"points"}, "PoseGrid": {"rotations"}, "Trajectory": {"coefficients"},
    "Trajectory.sample": {"times"},
    "dynamics": {"joints", "velocities"}, "fk": {"joints"}, "jacobian": {"joints"},
    "inverse_dynamics": {"joints", "velocities", "accelerations"},
}  # fmt: skip
#: Arguments of which any value of the type is right, infinities included.
ANY_VALUE = {
    "BoxRegion": {"size"}, "Checker.closest": {"within"}, "Checker.gradient": {"within"},
    "HalfSpace": {"offset"}, "Obstacle": {"id"}, "retime": {"limits"},
    "built_in_tool": {"name", "link"}, "with_tip": {"name"},
}  # fmt: skip


def functions() -> dict[str, Callable[..., Any]]:
    """Public functions, classes and methods that take arguments."""
    found = {name: getattr(aw, name) for name in cast(list[str], aw.__all__)}  # type: ignore[attr-defined]
    known: dict[str, Callable[..., Any]] = {
        name: one for name, one in found.items() if inspect.isfunction(one)
    }
    known |= {name: found[name] for name in CLASSES}
    for one in (aw.Checker.of(ROBOT, SCENE), MOTION):
        for name, method in inspect.getmembers(one, callable):
            if not name.startswith("_") and inspect.signature(method).parameters:
                known[f"{type(one).__name__}.{name}"] = method
    known |= {"Chain.configuration": CHAIN.configuration, "Chain.link": CHAIN.link}
    known["Scene.obstacle"] = SCENE.obstacle
    return {name: one for name, one in known.items() if name not in ELSEWHERE}


def arguments(name: str, function: Callable[..., Any]) -> dict[str, Any] | None:
    """Right arguments, or None where a parameter without a default has no value here."""
    given: dict[str, Any] = {}
    for key, parameter in inspect.signature(function).parameters.items():
        if key in OWN.get(name, {}):
            given[key] = OWN[name][key]
        elif key in RIGHT and key not in LEFT_OUT.get(name, ()):
            given[key] = RIGHT[key]
        elif key.startswith("T_"):
            given[key] = T
        elif parameter.default is parameter.empty and parameter.kind != parameter.VAR_KEYWORD:
            return None
    return given


def wrong(value: Any, *, any_shape: bool, any_value: bool) -> Iterator[tuple[str, Any]]:
    """Values that are none in place of a right one, each with a word for it."""
    if isinstance(value, bool):
        return
    yield "None", None
    if not any_value or not isinstance(value, str):
        yield "text", "nonsense"
    if isinstance(value, np.ndarray):
        if not any_shape:
            yield "one more", np.concatenate([value, value[..., :1]], axis=-1)
            yield "one less", value[..., :-1]
            yield "many more", np.concatenate([value] * 500, axis=-1)
            yield "empty", value[..., :0]
            yield "two dimensions more", value[None, None]
        yield "a number", 0.5
        yield "strings", np.full(value.shape, "a")
        yield "ragged", [[1.0], [1.0, 2.0]]
        if not any_value:
            yield "not a number", np.full(value.shape, np.nan)
            yield "infinite", np.full(value.shape, np.inf)
    elif isinstance(value, float):
        yield "not a number", np.nan
        yield "a list", [value]
        if not any_value:
            yield "negative", -0.5
            yield "infinite", np.inf
    elif not isinstance(value, str):
        yield "a number", 0.5
    else:
        yield "a number", 3


def call(function: Callable[..., Any], given: dict[str, Any]) -> None:
    """Call a function; one that gives its answers one by one gives all."""
    answer = function(**given)
    if isinstance(answer, Iterator):
        list(answer)


def main() -> None:
    """Call everything."""
    missing, failures, count = [], [], 0
    for name, function in functions().items():
        given = arguments(name, function)
        if given is None:
            missing.append(name)
            continue
        sys.stderr.write(f"{name}\n")  # the last line says where it ended
        sys.stderr.flush()
        call(function, given)
        for argument, value in given.items():
            any_shape = argument in ANY_SHAPE.get(name, ())
            any_value = argument in ANY_VALUE.get(name, ())
            for word, other in wrong(value, any_shape=any_shape, any_value=any_value):
                if other is None and _may_be_none(function, argument):
                    continue
                count += 1
                try:
                    call(function, given | {argument: other})
                except (aw.ArmwrightError, TypeError):
                    continue
                except Exception as error:  # noqa: BLE001  any other is a failure
                    failures.append([name, argument, word, repr(error)[:200]])
                else:
                    failures.append([name, argument, word, "answered"])
    sys.stdout.write(json.dumps({"count": count, "failures": failures, "missing": missing}))


def _may_be_none(function: Callable[..., Any], argument: str) -> bool:
    parameter = inspect.signature(function).parameters[argument]
    return "None" in str(parameter.annotation) or parameter.default is None


if __name__ == "__main__":
    main()
