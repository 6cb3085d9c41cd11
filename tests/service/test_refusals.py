"""Refusals over HTTP: changes of good requests, the code of each problem and words of it."""

from typing import Any

import httpx
import numpy as np
import pytest

from armwright_wire.plans.task import TaskRequest
from kinematics.forward import forward
from kinematics.pose import to_quaternion
from kinematics.robots import builtin_chain, builtin_urdf
from tests.service.planning import BODY as PLAN
from tests.service.robots import (
    ASIDE,
    FLOOR,
    HOME,
    POST,
    answer,
    bench,
    problem,
    scene,
)
from tests.service.schemas.drawn import FULL
from tests.service.test_simulate import HOLD, MOTORS, TORQUE

FORM, STATE, LINK = "VALIDATION_ERROR", "INVALID_ROBOT_STATE", "INVALID_LINK_NAME"
GOAL, MOTION = "INVALID_GOAL_CONSTRAINTS", "INVALID_MOTION_PLAN"
ROBOT, SCENE = "INVALID_ROBOT_DESCRIPTION", "INVALID_SCENE"
#: All others are 422.
STATUS = {"NOT_FOUND": 404}
Change = tuple[dict[str, Any], str, str]

TIP = forward(builtin_chain("panda"), HOME)
TURN = to_quaternion(TIP[:3, :3]).tolist()
POSE = {"position": [0.4, 0.0, 0.4]}
IN_THE_HAND = {"position": forward(builtin_chain("panda"), ASIDE)[:3, 3].tolist()}
XYZ: dict[str, Any] = {"method": "gradient", "axes": ["x", "y", "z"]}
UPRIGHT = {"type": "orientation", "axis": [0, 0, 1], "direction": [0, 0, -1], "cone_angle": 0.1745}
FLAT = {"type": "plane", "point": [0, 0, 0.5], "normal": [0, 0, 1], "tolerance": 0}
HELD = POST | {"link": "panda_hand"}
UP = [0, 0, 1]
POINTS = [[0.45, y, 0.35] for y in (-0.1, 0.0, 0.1)]
DOWN = [1.0, 0.0, 0.0, 0.0]
SPRING = [[0.0, 1.0], [-1.0, -1.0]]


def there(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> dict[str, Any]:
    """The tool's pose at home, moved."""
    return {"position": (TIP[:3, 3] + [x, y, z]).tolist(), "quaternion_xyzw": TURN}


def options(planner: str, **given: Any) -> dict[str, Any]:
    return {"planner": planner, "planner_options": given}


def tool(**given: Any) -> dict[str, Any]:
    """A line of the tool to the side, with options."""
    return {"goal": {"pose": there(0.0, 0.2)}, "scene": None} | options("cartesian", **given)


def seam(**given: Any) -> dict[str, Any]:
    waypoints = [{"point": p, "normal": UP} for p in POINTS]
    return {"goal": None, "scene": None} | options("cartesian", **{"waypoints": waypoints} | given)


def points(**given: Any) -> dict[str, Any]:
    """A seam of two waypoints with more of each."""
    return seam(waypoints=[{"point": p, "normal": UP} | given for p in POINTS[:2]])


def samples(duration: float = 3.0, **more: Any) -> dict[str, Any]:
    through = {"time": [0.0, duration], "position": [HOME, ASIDE]}
    return {"trajectory": {"samples": through, "interpolation": "clamped_spline"} | more}


def segments(*spans: tuple[float, float], n: int = 7) -> dict[str, Any]:
    rows = [{"t0": a, "t1": b, "coefficients": [[0.0]] * n} for a, b in spans]
    return {"trajectory": {"segments": rows}}


def stages(k: int, **change: Any) -> dict[str, Any]:
    """The stages of the example of a task, one of them changed."""
    made = [dict(stage) for stage in TASK["stages"]]
    made[k] = {name: value for name, value in (made[k] | change).items() if value is not None}
    return {"stages": made}


ROW: dict[str, Any] = {
    "type": "revolute", "a": 0.5, "alpha": 0.0, "d": 0.0, "theta": 0.0, "lower": -3.0,
    "upper": 3.0, "velocity": 3.0, "acceleration": 20.0, "mass": 1.0,
}  # fmt: skip
MOTOR = MOTORS[0]
BOX = {"shape": {"type": "box", "size": [0.4, 0.1, 0.1]}, "pose": {"position": [-0.25, 0.0, 0.0]}}
HALF = {"shape": {"type": "halfspace", "normal": [0.0, 0.0, 1.0], "offset": 0.0}}


def rows(*more: dict[str, Any], **table: Any) -> dict[str, Any]:
    return {"dh": {"convention": "standard", "rows": [ROW | row for row in more]} | table}


PATH = [[0.0, 0.0], [1.0, 0.2], [1.2, 1.0], [0.3, 1.4]]
LIMITS = {"velocity": [1.0, 1.5], "acceleration": [4.0, 3.0], "jerk": [40.0, 30.0]}
JERKLESS = {"velocity": [1.0, 1.0], "acceleration": [1.0, 1.0]}
GRID: dict[str, Any] = {
    "size": [0.8, 0.6, 0.0], "pose": {"position": [0.45, 0.0, 0.3]}, "spacing": 0.1,
    "orientations": [DOWN],
}  # fmt: skip
AT = {"poses": [{"position": [0, 0, 1]}], "box": None}
HOLES = [
    {"id": f"hole_{k}", "pose": {"position": [0.45, y, 0.4], "quaternion_xyzw": DOWN}}
    for k, y in enumerate((-0.35, 0.08, -0.1))
]
TASK: Any = TaskRequest.model_json_schema()["examples"][0]
LEARNER = {
    "type": "adaptive", "Lambda": 5.0, "K": 5.0, "Gamma": 2.0, "known_zeros": True,
    "parameters": ["mx2"],
}  # fmt: skip

#: Three configurations, a log of them, and as many points.
STILL, ORIGINS = [[0.0] * 6] * 3, [[0.0] * 3] * 3
LOG = {"positions": STILL, "torques": STILL}
FLAT_BODY = {"mass": 1.0, "center_of_mass": [0.0] * 3, "inertia": [[0.1] * 3] * 3}
GRIPPER: dict[str, Any] = {"name": "a", "tcp": {"tip": POSE, "side": POSE}, "mass": 2.0}

#: By noun: a path, the body of a good request; what is changed in it (None leaves a field out), the
#: code and words of the problem.
TABLE: dict[str, tuple[str, dict[str, Any], list[Change]]] = {
    "fk": ("/v1/robots/panda/fk", {"joints": HOME}, [
        ({"joints": HOME[:-1]}, STATE, "7"),
        ({"joints": [HOME, HOME[:-1]]}, STATE, "rows of equal length"),
        ({"link": "nose"}, LINK, "nose"),
    ]),
    "jacobian": ("/v1/robots/panda/jacobian", {"joints": HOME}, [
        ({"joints": HOME[:-1]}, STATE, "7"),
        ({"link": "nose"}, LINK, "nose"),
        ({"kind": "analytic_zyz", "link": "panda_link0"}, FORM, "geometric"),
    ]),
    "velocity": ("/v1/robots/panda/velocity", {"joints": HOME, "twist": [0] * 6}, [
        ({"twist": [0] * 5}, FORM, "twist"),
        ({"twist": [[0] * 6] * 2}, FORM, ""),
        ({"joints": [HOME] * 3, "twist": [[0] * 6] * 2}, FORM, ""),
    ]),
    "ik": ("/v1/robots/panda/ik", {"pose": POSE}, [
        ({"link": "x"}, LINK, "'x'"),
        ({"scene": "x"}, "NOT_FOUND", "'x'"),
        ({"seed_joints": [1]}, STATE, "7"),
        ({"method": "numeric", "parameters": [0.5]}, FORM, "parameter"),
        ({"method": "numeric", "constraints": [UPRIGHT]}, FORM, ""),
        ({"method": "auto", "posture": HOME}, FORM, "posture"),
        ({"method": "constrained", "pose": None}, FORM, ""),
        ({"constraints": [{"type": "tool_speed", "limit": 1}]}, GOAL, "plan"),
        ({"method": "auto", "gradient": {"steps": 2}}, FORM, "gradient"),
        (XYZ | {"gradient": {"gain": [[1.0, 0.0], [0.0, 1.0]]}}, FORM, "3 x 3 matrix"),
        (XYZ | {"gradient": {"gain": np.diag([1.0, 1.0, -1.0]).tolist()}}, FORM, "positive real"),
        (XYZ | {"gradient": {"rule": "transpose", "gain": [[1, 1, 0], [0, 1, 0], [0, 0, 1]]}},
         FORM, "symmetric"),
        (XYZ | {"gradient": {"trace_points": 5}}, FORM, "trace"),
        (XYZ | {"pose": None, "poses": [POSE], "gradient": {"trace": True}}, FORM, "trace"),
    ]),
    "ik of others": ("/v1/robots/scara/ik", {"pose": POSE}, [
        ({"parameters": [0.5]}, FORM, "parameter"),
        ({"method": "analytic", "axes": ["x", "y"]}, FORM, "numeric"),
    ]),
    "check": ("/v1/check", {"robot": "panda", "scene": scene(POST), "joints": HOME}, [
        ({"scene": "nowhere"}, "NOT_FOUND", "nowhere"),
        ({"joints": HOME[:3]}, STATE, "7"),
        ({"joints": [HOME, [0.0]]}, STATE, ""),
        ({"scene": {"obstacles": [POST, POST]}}, FORM, "twice"),
        ({"scene": {"moveit": "- 1"}}, SCENE, ""),
        ({"attached": [POST | {"link": "nose"}], "scene": None}, LINK, "nose"),
        ({"attached": [{"id": "mug", "pose": POST["pose"], "link": "panda_hand"}]}, SCENE, "mug"),
        ({"attached": [HELD | {"touch_links": ["nose"]}]}, LINK, "nose"),
        ({"attached": [HELD] * 2}, SCENE, "post"),
        ({"attached": [HELD | {"id": "panda_hand"}]}, SCENE, "panda_hand"),
        ({"attached": [{"id": "plate", "link": "panda_hand", "shape": POST["shape"],
                        "grasp_joints": HOME}]}, "INVALID_OBJECT_NAME", "plate"),
        ({"allowed_collisions": [["panda_hand", "nose"]]}, "INVALID_OBJECT_NAME", "nose"),
    ]),
    "plan": ("/v1/plan", PLAN, [
        ({"scene": "nowhere"}, "NOT_FOUND", "nowhere"),
        ({"start": {"joints": HOME[:6]}}, STATE, "6 value(s)"),
        ({"goal": {"joints": [*ASIDE, 0.0]}}, STATE, "goal"),
        ({"goal": {"any_of": [{"joints": ASIDE}, {"joints": [*ASIDE, 0.0]}]}}, STATE, "goal"),
        ({"planner": "teleport"}, FORM, "rrt_connect"),
        ({"timing": {"times": [0.0, 1.0]}}, FORM, "times"),
        ({"timing": {"method": "spline", "solver": "toppra"}}, FORM, "solver"),
        ({"timing": {"solver": "toppra"}, "refine": True}, FORM, ""),
        ({"timing": {"sample_period": 1e-4, "velocity_scaling": 1e-4}}, FORM, "sample"),
        ({"margin": 0.01, "clearance": {"least": 0.02}}, FORM, "clearance.least"),
        ({"goal": {"pose": {"position": [2.0, 0.0, 0.5]}}}, "NO_IK_SOLUTION", "reach"),
        ({"goal": {"joints": [*ASIDE[:5], 9.0, 0.0]}}, "GOAL_STATE_INVALID", "panda_joint6"),
        ({"scene": scene(POST | {"id": "crate", "pose": IN_THE_HAND})}, "GOAL_IN_COLLISION",
         "crate"),
        ({"start": {"joints": [*HOME[:3], -0.0698 + 5e-7, *HOME[4:]]},
          "start_state_tolerance": 1e-9}, "START_STATE_INVALID", "panda_joint4"),
    ]),
    "options of planners": ("/v1/plan", PLAN, [
        (options("rrt_connect", rage=1), FORM, "rage"),
        (options("BITstar", samples_per_batch=0), FORM, "samples_per_batch"),
        (options("potential_field", attractive_weights=[1, 2]), FORM, "2 value"),
        (options("potential_field", keep_path=True, fallback="rrt_connect"), FORM, "Leave one"),
        *((options("potential_field", fallback=name), FORM, "planner_options.fallback")
          for name in ("auto", "optimize", "magic", 3)),
        (options("auto", range=1.0), FORM, "no options"),
        (options("straight_line", range=1.0), FORM, "no options"),
        (options("optimize", objective="fun"), FORM, "objective"),
    ]),
    "optimized plans": ("/v1/plan", PLAN | {"planner": "optimize"}, [
        ({"start": {"joints": HOME, "velocities": [0.1] * 6}}, STATE, ""),
        ({"start": {"joints": HOME, "velocities": [9.0] * 7}}, "START_STATE_INVALID", ""),
        ({"goal": {"joints": ASIDE, "velocities": [9.0] * 7}}, "GOAL_STATE_INVALID", ""),
        ({"refine": True}, FORM, "refine"),
        ({"refine": {"duration": 0.01}, "planner": "auto"}, MOTION, ""),
    ]),
    "constraints": ("/v1/plan", PLAN | {"goal": {"joints": HOME}}, [
        ({"constraints": [constraint]}, code, words) for constraint, code, words in (
            ({"type": "upright"}, FORM, "upright"),
            (UPRIGHT | {"link": "nose"}, LINK, "nose"),
            (UPRIGHT | {"link": "panda_link0"}, GOAL, "panda_link0"),
            ({"type": "position", "region": FLAT}, GOAL, "Widen"),
        )
    ]),
    "tool motions": ("/v1/plan", PLAN, [
        (tool(motion=[]), FORM, "planner_options.motion"),
        (tool(through="spline"), FORM, "waypoints"),
        (tool(motions=[{"type": "lin", "pose": there(0.0, 0.1)}]), GOAL, "from the goal"),
        (tool(motions=[{"type": "circ", "pose": there(0.0, 0.2),
                        "via": there(0.0, 0.1)["position"]}]), GOAL, "lie on one line"),
        (tool() | {"goal": {"any_of": [{"pose": there(0.0, y)} for y in (0.1, 0.2)]}}, GOAL, ""),
        (tool() | {"timing": {"method": "spline", "times": [0.0, 1.0]}}, FORM, ""),
    ]),
    "seams": ("/v1/plan", PLAN, [
        (seam(waypoints=[{"point": POINTS[0], "normal": UP}]), FORM, "waypoints"),
        (seam(waypoints=[{"point": POINTS[0]}] * 2), FORM, "point needs normal"),
        (seam(motions=[]), FORM, "motions"),
        (seam(tolerance={"x": [0.1, -0.1]}), FORM, "0.1 is above -0.1"),
        (seam(tolerance={"rz": [0.0, 0.1], "free": ["rz"]}), FORM, "rz has a range"),
        (seam(tolerance={"tilt": 0.0}), FORM, "tilt"),
        (seam(tolerance={"frame": "moon"}), LINK, "moon"),
        (seam(tolerance={"frame": "panda_hand"}), LINK, "moves with the arm"),
        (points(tool_speed=0.0), FORM, "waypoints[0].tool_speed"),
        (points(free=["x"], tolerance={"x": [0.0, 0.1]}), FORM, "x has a range and is free"),
        (points(free=["ry"]), FORM, "waypoints[0].free: tolerance of ry"),
        (points(point=POINTS[0]), GOAL, "waypoints[1] is at the place of waypoints[0]"),
        (points(direction=UP), GOAL, "direction is along the normal"),
        (seam(approach={"direction": [0, 0, 0], "distance": 0.1}), FORM, "no length"),
    ]),
    "validate": ("/v1/validate", {"robot": "panda"} | samples(), [
        (samples(interpolation="cubic"), FORM, "cubic"),
        (samples(0.0), MOTION, ""),
        (samples(-1.0), MOTION, ""),
        (samples(joint_names=["a"]), MOTION, "joint"),
        (segments((0, 1), n=1), MOTION, "1 joint"),
        (segments((0, 1), (2, 3)), MOTION, "segments[1] begins at 2 s"),
        ({"trajectory": {"samples": {"time": [0, 1], "position": [HOME, HOME[:6]]},
                         "interpolation": "linear"}}, MOTION, "samples.position[1] has 6 value"),
        ({"limits": {"velocity": [1.0]}}, FORM, "7 positive numbers"),
        ({"tool_motions": {"motions": [
            {"type": "lin", "pose": there(), "part": "seam", "tolerance": {"ry": [-1.5, 1.5]}}
        ]}}, FORM, "tool_motions.motions[0].tolerance"),
    ]),
    "retime": ("/v1/retime", {"path": {"joints": PATH}, "limits": LIMITS}, [
        ({"limits": {"velocity": [1.0, 1.0]}}, "MISSING_LIMIT", "acceleration"),
        ({"limits": None}, "MISSING_LIMIT", "joint1, joint2"),
        ({"limits": JERKLESS, "timing": {"method": "jerk_limited"}}, "MISSING_LIMIT", "jerk"),
        ({"limits": LIMITS | {"velocity": [1.0]}}, FORM, "2 positive numbers"),
        ({"limits": LIMITS | {"velocity": [1.0, 0.0]}}, FORM, "positive"),
        ({"path": {"joints": [[0.0, 0.0], [1.0]]}}, MOTION, "path.joints[1]"),
        ({"path": {"joints": [[0.0] * 3, [0.0] * 2]}}, MOTION,
         "path.joints[1] has 2 value(s) in place of 3"),
        ({"path": {"joints": [[0.0] * 3]}, "robot": "planar_rr"}, MOTION,
         "path.joints[0] has 3 value(s) in place of 2"),
        ({"path": {"joints": PATH, "joint_names": ["b", "a"]}, "robot": "planar_rr"}, MOTION,
         "not those of the robot in its order"),
        ({"path": {"joints": PATH, "knots": [0, 1, 2, 3]}}, FORM, "knots"),
        ({"timing": {"times": [0.0, 1.0]}}, FORM, "times"),
        ({"timing": {"method": "spline", "times": [0.0, 1.0]}}, MOTION, "times"),
        ({"timing": {"method": "spline", "interpolation": "linear"}}, FORM, "linear"),
        ({"timing": {"method": "spline", "solver": "toppra"}}, FORM, "to the method toppra"),
        ({"timing": {"start_velocity": [0.0, 1.0]}}, FORM, "start_velocity"),
        ({"timing": {"torque_limits": True}}, FORM, "robot"),
        ({"limits": {"velocity": [1e-200] * 2, "acceleration": [4.0] * 2},
          "timing": {"solver": "toppra", "blend_tolerance": 0.1}}, MOTION, "timing.solver"),
    ]),
    "retime of states": (
        "/v1/retime",
        {"from": {"position": [0.0, 0.0]}, "to": {"position": [1.0, 0.5]}, "limits": LIMITS},
        [
            ({"timing": {"times": [0.0, 1.0]}}, FORM, "timing.times belongs to a path"),
            ({"timing": {"method": "toppra"}}, FORM, "can only be jerk_limited"),
            ({"to": {"position": [1.0]}}, MOTION, "to.position has 1 value(s) in place of 2"),
            ({"to": {"position": [1.0] * 2, "velocity": [1.0]}}, MOTION, "has 1 value(s) for 2"),
            ({"joint_names": ["a", "a"]}, MOTION, "2 different names"),
            *(({"from": None, "to": None, "path": {"joints": PATH, "joint_names": names}}, MOTION,
               "must be 2 different names") for names in (["a"], ["a", "a"], ["a", "b", "c"])),
            ({"limits": JERKLESS}, "MISSING_LIMIT", "no jerk limit"),
        ],
    ),
    "export": ("/v1/export", {"robot": "panda"} | samples(), [
        ({"format": "krl", "name": "x;y"}, FORM, "name"),
        ({"format": "urscript_movej"}, FORM, "moves 6 joints, robot 'panda' has 7"),
        ({"format": "csv", "blend": 1.0}, FORM, "blend"),
        ({"format": "rapid", "interpolation": "cubic"}, FORM, "interpolation"),
    ]),
    "reach": ("/v1/robots/panda/reach", {"box": GRID}, [
        (AT | {"bases": []}, FORM, "bases"),
        (AT | {"format": "svg"}, FORM, "a picture needs box"),
        (AT | {"frame": "panda_link3"}, LINK, "panda_link3"),
        ({"box": GRID | {"spacing": 1e-4}}, FORM, "at most 1000000"),
        ({"box": GRID | {"orientations": [[0, 0, 0, 2.0]]}}, FORM, "quaternion"),
        ({"box": GRID | {"orientations": [DOWN, DOWN]}, "format": "svg"}, FORM, "one orientation"),
        ({"tolerance": {"x": [0.1, -0.1]}}, FORM, "above"),
        ({"tolerance": {"free": ["rz"], "samples": 0}}, FORM, "samples"),
        ({"tolerance": {"free": ["rz"], "rz": [0, 1]}}, FORM, "rz has a range and is free"),
        ({"link": "nowhere"}, LINK, "nowhere"),
        ({"base_region": {"x": [1, 0], "y": [0, 0], "spacing": 1}}, FORM, "above"),
        ({"base_region": {"x": [0, 9], "y": [0, 9], "spacing": 1e-3}}, FORM, "candidates"),
        ({"box": GRID | {"pose": {"position": [9.0, 0.0, 0.0]}}, "format": "glb"}, FORM,
         "no point of the box is reached"),
    ]),
    "tours": (
        "/v1/tours",
        {"robot": "panda", "scene": scene(FLOOR, POST), "start": {"joints": HOME}, "goals": HOLES},
        [
            ({"goals": [HOLES[0], {"pose": POSE | {"frame": "moon"}}]}, LINK, "moon"),
            ({"goals": [HOLES[0], {"pose": POSE, "tolerance": {"x": [0.01, -0.01]}}]}, FORM,
             "goals[1].tolerance"),
            ({"goals": [HOLES[0]] * 501}, FORM, "500"),
            ({"goals": [HOLES[0], HOLES[0]]}, GOAL,
             "goals[0] and goals[1] have the same id 'hole_0'"),
            ({"precedence": [["hole_0", "hole_1"], ["hole_1", "hole_2"], ["hole_2", "hole_0"]]},
             GOAL, "before hole_0"),
            ({"precedence": [["hole_0", "nothing"]]}, GOAL, "'nothing'"),
            ({"start": None, "end": "start"}, GOAL, "no start is given"),
            ({"start": {"joints": [0.0] * 6}}, STATE, "start.joints"),
            ({"goals": [HOLES[0], {"joints": [0.0] * 3}]}, STATE, "goals[1].joints"),
            ({"goals": [HOLES[0], {"any_of": [{"joints": HOME, "velocities": [1.0] * 7}]}]},
             FORM, "no velocities"),
            ({"goals": [HOLES[0], {"state": "ready", "tolerance": {"free": ["rz"]}}]}, FORM,
             "tolerance belongs to pose or any_of"),
            ({"timing": {"method": "spline", "times": [0.0, 1.0]}}, FORM, "many legs"),
            ({"start": {"joints": [0.59, 0.3, 0.0, -2.0, 0.0, 2.2, 0.0]}},
             "START_STATE_IN_COLLISION", "at the start"),
        ],
    ),
    "tasks": ("/v1/tasks", TASK, [
        (stages(2, region=None, grasps=[]), FORM, "stages[2].grasps"),
        (stages(2, region=None, grasps=[{"position": [0, 0, 0]}] * 10_001), FORM,
         "stages[2].grasps"),
        (stages(2, region=None), FORM, "stages[2]"),
        (stages(2, region=None, grasps=[{"position": [0, 0, 0], "frame": "moon"}]), FORM,
         "stages[2].grasps[0].frame"),
        (stages(8, region=None, poses=[]), FORM, "stages[8].poses"),
        (stages(8, region={"pose": {"position": [0.5, 0, 0.2]}, "samples": [0, 1, 1]}), FORM,
         "samples"),
        (stages(5, distance=[0.1]), FORM, "stages[5].distance"),
        (stages(0, blend=0.1), FORM, "stages[0]"),
        (stages(12, blend=0.0), FORM, "stages[12].blend"),
    ]),
    "dynamics": ("/v1/robots/panda/dynamics", {"joints": HOME}, [
        ({"joints": [0.0]}, STATE, "7"),
        ({"joints": [HOME] * 3, "velocities": [HOME] * 2}, STATE, "velocities"),
        ({"payload": {"mass": 1, "link": "x"}}, LINK, "'x'"),
        ({"motor_inertia": [1.0]}, FORM, "inertia must be"),
        ({"joints": [HOME] * 3000, "christoffel_symbols": True}, FORM, "several requests"),
    ]),
    "wrench": ("/v1/robots/panda/wrench", {"joints": HOME, "wrench": [0] * 6}, [
        ({"joints": [HOME], "wrench": [[0] * 6] * 2}, STATE, "do not fit"),
        ({"link": "x"}, LINK, "'x'"),
    ]),
    "regressor": ("/v1/robots/panda/regressor", {"joints": HOME, "accelerations": HOME}, [
        ({"velocities": [0.0]}, STATE, "velocities"),
    ]),
    "forward dynamics": ("/v1/robots/panda/forward-dynamics", {"joints": HOME}, [
        ({"joints": [0.0]}, STATE, "7"),
        ({"torques": [1.0]}, STATE, "torques"),
        ({"joints": [HOME] * 3, "torques": [HOME] * 2}, STATE, "torques"),
    ]),
    "simulate": (
        "/v1/simulate",
        {"robot": "planar_rr", "saturate": False, "reference": HOLD, "controller": TORQUE},
        [
            ({"controller": {"type": "passivity"}}, FORM, "Lambda"),
            ({"controller": {"type": "computed_torque", "Kp": [1.0], "Kd": 1.0}}, FORM, "Kp"),
            *(({"controller": {"type": kind, "damping": 0.5} | gains}, FORM,
               "damping has no effect") for kind, gains in (
                ("passivity", {"natural_frequency": 5.0}),
                ("adaptive", {"natural_frequency": 5.0}),
                ("computed_torque", {"Kp": 1.0, "Kd": 1.0}))),
            ({"controller": LEARNER | {"parameters": ["mx3"]}}, FORM,
             "the base parameter 'mx3' is unknown"),
            ({"controller": LEARNER | {"estimate": [0.1, 0.2]}}, FORM, "must be 1 finite numbers"),
            ({"controller": LEARNER | {"Gamma": [1.0, 2.0]}}, FORM, "Gamma"),
            ({"sample_period": 1e-7}, FORM, "samples"),
            ({"control_period": 1e-6}, FORM, "Give at least 1e-05 s."),
            ({"initial_state": {"offset": [1.0]}}, STATE, "initial_state.offset"),
            ({"initial_state": {"joints": [1e9, 0.0]}}, STATE, "the initial position of joint"),
            ({"initial_state": {"velocities": [0.0, -1e9]}}, STATE, "initial velocity of joint"),
            ({"disturbance": {"torque": [1.0, 2.0, 3.0]}}, STATE, "disturbance"),
            ({"disturbance": {"torque": 1.0, "start": 2.0}}, FORM, "never acts"),
            ({"reference": HOLD | {"joints": [0.1]}}, STATE, "reference.joints"),
            ({"reference": None}, FORM, "exactly one of trajectory, reference"),
        ],
    ),
    "lyapunov": ("/v1/lyapunov", {"A": SPRING, "P": SPRING}, [
        ({"Q": SPRING}, FORM, "exactly one of P, Q"),
        ({"A": [[1.0, 2.0]], "P": [[1.0]]}, FORM, "A[0] has 2 number(s), A has 1 rows"),
        ({"P": [[1.0]]}, FORM, "A is 2 x 2, P is 1 x 1"),
        ({"x": [1.0]}, FORM, "x has 1 number(s), A has 2 rows"),
        ({"x": [[1.0, 2.0], [1.0]]}, FORM, "x[1] has 1 number(s)"),
        ({"A": [[0.0, 1.0], [-1.0, 0.0]], "P": None, "Q": np.eye(2).tolist()}, FORM, "add up to 0"),
        ({"P": None, "Q": [[1.0, 1.0], [0.0, 1.0]]}, FORM, "Q is not symmetric"),
    ]),
    "lyapunov of formulas": ("/v1/lyapunov", {"f": ["-x1"], "V": "x1**2"}, [
        ({"f": ["x2", "-x1 + y"]}, FORM, "f[1]: 'y' is no name of a formula (character 7)"),
        ({"f": ["1 + x1"]}, FORM, "f[0] is 1 at x = 0"),
        ({"x": [1.0, 2.0]}, FORM, "x has 2 number(s), f has 1 formulas"),
        ({"V": None}, FORM, "give exactly one of P, Q, V, system"),
        ({"A": [[1.0]]}, FORM, "A belongs to P or Q"),
        ({"f": None, "V": None, "P": [[1.0]]}, FORM, "P belongs to A"),
        ({"f": None, "V": None, "system": "pendulum"}, FORM, "system belongs to parameters"),
        ({"V": "x" * 501}, FORM, "V"),
    ]),
    "tools": ("/v1/check", {"robot": "ur5e", "joints": [0.0, -1.2, 1.2, -1.5, -1.5, 0.0]}, [
        ({"tool": "nothing_such"}, "NOT_FOUND", "nothing_such"),
        ({"tool": "torch", "tcp": "end"}, LINK, "'torch' has no tip 'end'"),
        ({"tcp": "tip"}, FORM, "names none"),
        ({"tcp": {"object": "peg"}}, "INVALID_OBJECT_NAME", "'peg'"),
        ({"tool": {"name": "a"}}, FORM, "tcp, form"),
        ({"tool": {"name": "tool", "form": {"type": "torch"}}}, FORM, "'tool'"),
        ({"tool": {"name": "a", "form": {"type": "claw"}}}, FORM, "parallel_jaw"),
        ({"tool": GRIPPER | {"link": "elbow"}, "tcp": "tip"}, LINK, "'elbow'"),
        ({"tool": GRIPPER}, LINK, "2 tips"),
        ({"tool": GRIPPER | {"inertia": np.diag([1.0, 1.0, 3.0]).tolist()}}, FORM,
         "principal moments"),
        ({"tool": GRIPPER | {"opening": [0.0, 0.1]}}, FORM, "opening"),
    ]),
    "identify": ("/v1/robots/ur5e/identify", {"logs": [LOG]}, [
        ({"logs": [{"positions": STILL}]}, FORM, "torques, currents"),
        ({"logs": [{"positions": STILL, "currents": STILL}]}, FORM, "gains"),
        ({"logs": [{"positions": STILL * 6000, "torques": STILL * 6000}] * 3}, FORM,
         "54000 instants"),
        ({"logs": [{"positions": STILL, "currents": STILL, "gains": [1.0]}]}, FORM, "1 gains"),
        ({"link": "tool0"}, FORM, "payload"),
        ({}, FORM, "18 equations"),
        ({"logs": [LOG | {"torques": STILL[:2]}]}, FORM, "2 torques"),
        ({"find": "payload", "link": "nowhere"}, LINK, "nowhere"),
    ]),
    "calibrate": ("/v1/robots/ur5e/calibrate", {"joints": STILL}, [
        ({}, FORM, "exactly one"),
        ({"positions": ORIGINS, "distances": [1.0] * 3, "anchor": [0.0] * 3}, FORM, "exactly"),
        ({"distances": [1.0] * 3}, FORM, "anchor"),
        ({"positions": ORIGINS[:2]}, FORM, "2 measurements"),
        ({"plane": {"point": [0.0] * 3, "normal": [0.0] * 3}}, FORM, "normal is 0"),
        ({"positions": ORIGINS}, FORM, "times the tolerance"),
    ]),
    "poses": ("/v1/poses/convert", {"pose": {"position": [0.0] * 3}}, [
        ({"pose": None}, FORM, "exactly one of pose, motions"),
        ({"pose": None, "motions": []}, FORM, "motions"),
        ({"pose": {"about": "fixed"}}, FORM, "about"),
        ({"pose": None, "motions": [{"about": "moved"}]}, FORM, "current"),
        ({"angular_velocity": [1.0]}, FORM, "angular_velocity"),
    ]),
    "potential": (
        "/v1/robots/panda/potential",
        {"joints": HOME, "goal_joints": ASIDE, "scene": scene(POST)},
        [
            ({"scene": "nowhere"}, "NOT_FOUND", "nowhere"),
            ({"joints": [0.0] * 6}, STATE, "7"),
            ({"goal_joints": [0.0] * 8}, STATE, "7"),
            ({"options": {"attractive_weights": [1.0, 2.0]}}, FORM, "there are 7 control points"),
            ({"options": {"influence_distance": 1e-4}}, FORM, "least_distance is 0.001 m"),
            ({"options": {"point_radii": [0.1, 0.2]}}, FORM, "there are 7 control points"),
            ({"options": {"point_radii": -0.1}}, FORM, "options.point_radii"),
            ({"options": {"preset": "quick", "point_radii": 0.1}}, FORM, "radii are those of"),
        ],
    ),
    "robots of tables": ("/v1/robots", {"name": "refused"} | rows({}), [
        ({"urdf": "<a/>"}, FORM, "exactly one"),
        ({"name": "x/y"}, FORM, "name"),
        ({"joint_limits": {"joint_9": {"velocity": 1.0}}}, ROBOT, "joint_1"),
        (rows({"continuous": True}), FORM, "a continuous joint has neither lower nor upper"),
        ({"visual_solids": True}, FORM, "visual_solids"),
        (rows({}, {"geometry": [{"shape": {"type": "egg"}}]}), FORM,
         "dh.rows[1].geometry[0].shape"),
        (rows({}, {"geometry": [{"pose": BOX["pose"]}]}), FORM, "dh.rows[1].geometry[0].shape"),
        (rows({"geometry": BOX}), FORM, "dh.rows[0].geometry"),
        (rows({}, {"geometry": [HALF]}), ROBOT, "row 2 of the DH table, geometry 1: a half-space"),
        (rows({"motor": MOTOR}, {}), ROBOT, "joint_2 have no motor"),
        (rows({"motor": MOTOR | {"resistance": 0.0}}), FORM, "dh.rows[0].motor.resistance"),
        (rows({"motor": {"gear_ratio": 2.0}}), FORM, "dh.rows[0].motor.inertia"),
        (rows({"motor": MOTOR, "motor_inertia": 0.1}), FORM, "give motor or motor_inertia"),
        (rows({"motor": MOTOR | {"gear_ratio": 1e9}}), ROBOT, "joint_1 has the inertia 1.2e+14"),
        (rows({"motor": MOTOR | {"resistance": 1e-300}}), ROBOT, "has the friction"),
    ]),
    "robots of files": ("/v1/robots", bench("refused"), [
        ({"urdf": builtin_urdf("planar_rr"), "motors": {"elbow_3": MOTOR}, "joint_limits": None},
         ROBOT, "motors names the joint 'elbow_3', which the chain does not have"),
        ({"meshes": {"a": "?"}}, FORM, "meshes"),
        ({"inertias": {"origin": "by hand", "links": {"upper": FLAT_BODY}}}, FORM, "moments"),
        ({"default_limits": {"acceleration": "many"}}, FORM, "default_limits"),
        ({"default_limits": {"acceleration": "9 x effort"}}, ROBOT, "effort"),
        ({"default_limits": {"velocity": "9 x effort"}}, FORM, "velocity"),
        ({"joint_limits": "nothing"}, ROBOT, "joint_limits"),
        ({"joint_limits": {"*": {"speed": 1.0}}}, FORM, "speed"),
        ({"held": {"shoulder": 0.1}}, ROBOT, "part of the chain"),
        ({"held": {"knee": 0.1}}, ROBOT, "no such joint"),
    ]),
}  # fmt: skip
CASES = [
    pytest.param(noun, path, body | change, code, words, id=f"{noun} {k}")
    for noun, (path, body, changes) in TABLE.items()
    for k, (change, code, words) in enumerate(changes)
]


#: Nouns of which some problems say it all in their details.
HINTLESS = ("ik", "check", "retime of states", "reach")


@pytest.mark.parametrize(("noun", "path", "body", "code", "words"), CASES)
def test_what_is_wrong_is_told_by_code_and_words(
    client: httpx.Client, noun: str, path: str, body: dict[str, Any], code: str, words: str
) -> None:
    given = {name: value for name, value in body.items() if value is not None}
    document = problem(client.post(path, json=given), STATUS.get(code, 422), code)
    assert words in str(document), document
    assert document["hint"] or noun in HINTLESS


def test_every_endpoint_names_unknown_fields_and_robots(client: httpx.Client) -> None:
    bodies = {model.__name__: body for model, body in reversed(FULL)}
    judged = set()
    for path, methods in answer(client.get("/openapi.json"))["paths"].items():
        content = methods.get("post", {}).get("requestBody", {}).get("content", {})
        reference = content.get("application/json", {}).get("schema", {}).get("$ref", "")
        body = bodies.get(reference.split("/")[-1])
        if body is None:
            continue
        known = path.replace("{name}", "panda")
        told = problem(client.post(known, json=body | {"surprise": 1}), 422, FORM)
        assert {"path": "surprise", "problem": "unknown field"} in told["details"]["errors"], path
        judged.add(path)
        unknown = path.replace("{name}", "nobody")
        # A tool is looked for before the robot that carries it.
        mounts = ("tool", "tcp") if "robot" in body or "{name}" in path else ()
        bare = {name: value for name, value in body.items() if name not in mounts}
        named = bare | ({"robot": "nobody"} if "robot" in body else {})
        # A bundle is read before its robot is looked for.
        if path != "/v1/plans" and (named, unknown) != (body, known):
            problem(client.post(unknown, json=named), 404, "NOT_FOUND")
    assert len(judged) > 20
