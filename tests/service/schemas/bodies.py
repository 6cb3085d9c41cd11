"""Valid bodies of every endpoint, with every field of requests."""

from typing import Any

import numpy as np
from pydantic import BaseModel

from armwright_wire.motions.excitation import ExcitationRequest
from armwright_wire.motions.export import ExportRequest
from armwright_wire.motions.retime import ConvertRequest, FitRequest, RetimeRequest, SimplifyRequest
from armwright_wire.motions.simulation import SimulateRequest
from armwright_wire.plans.batch import BatchRequest
from armwright_wire.plans.guard import GuardChange, GuardRequest
from armwright_wire.plans.kept_plan import Bundle, ReplayRequest, StopRequest
from armwright_wire.plans.plan import PlanRequest, ValidateRequest
from armwright_wire.plans.tour import TourRequest
from armwright_wire.pose import ConvertPoseRequest
from armwright_wire.robots.calibration import CalibrateRequest
from armwright_wire.robots.dynamics import (
    DynamicsRequest,
    ForwardDynamicsRequest,
    RegressorRequest,
    WrenchRequest,
)
from armwright_wire.robots.identification import IdentifyRequest
from armwright_wire.robots.kinematics import FkRequest, IkRequest, JacobianRequest, VelocityRequest
from armwright_wire.robots.lyapunov import LyapunovRequest
from armwright_wire.robots.potential import PotentialRequest
from armwright_wire.robots.reach import ReachRequest
from armwright_wire.robots.robot import ArchiveFields, RobotBody, RobotChanges
from armwright_wire.scenes.check import CheckRequest
from armwright_wire.scenes.scene import NamedScene, ProjectRequest
from armwright_wire.scenes.tool import NamedTool, Tool
from tests.service.schemas.task_bodies import MARGINS, tasks

IDENTITY = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
PAYLOAD = {"mass": 1.5, "center_of_mass": [0.0, 0.0, 0.1], "inertia": IDENTITY, "link": "hand"}
MOTOR = {
    "inertia": 1e-4, "friction": 1e-5, "torque_constant": 0.1, "back_emf": 0.1, "resistance": 1.0,
    "gear_ratio": 100.0, "voltage_limit": 24.0,
}  # fmt: skip
INERTIAS: dict[str, Any] = {
    "origin": "identified from 2 logs",
    "links": {"hand": {"mass": 1.0, "center_of_mass": [0.0] * 3, "inertia": IDENTITY}},
    "motor_inertia": [0.1], "viscous_friction": [0.2], "coulomb_friction": [0.3],
}  # fmt: skip
CALIBRATION: dict[str, Any] = {
    "origin": "a laser tracker", "joints": {"j1": {"position": [0.0, 0.0, 0.001]}},
    "file": "kinematics: {}",
}  # fmt: skip
ACCURACY = {"position": 1e-4, "rotation": 1e-3}
MEASURED: list[dict[str, Any]] = [
    {"poses": [{"position": [0.4, 0.0, 0.3]}]},
    {"positions": [[0.4, 0.0, 0.3]]},
    {"distances": [0.5], "anchor": [1.0, 0.0, 0.0]},
    {"plane": {"point": [0.0, 0.0, 0.1], "normal": [0.0, 0.0, 1.0]}},
]
LOG = {name: [[0.1], [0.2]] for name in ("positions", "velocities", "accelerations")}
#: What `POST /v1/simulate` takes beside the motion, the controller and what is around the robot.
SIMULATE: dict[str, Any] = {
    "robot": "panda", "scene": "table", "frame": "base",
    "model_error": {
        "mass_scale": 1.2, "payload": PAYLOAD, "motor_inertia": 0.1,
        "viscous_friction": [0.1, 0.2], "coulomb_friction": 0.1, "gravity": [0.0, 0.0, -9.0],
        "inertias": {"hand": {"mass": 1.0, "center_of_mass": [0.0] * 3, "inertia": IDENTITY}},
    },
    "disturbance": {"torque": 1.0, "amplitude": [1.0, 2.0], "frequency": 2.0, "wrench": [1.0] * 6,
                    "start": 0.1, "end": 0.5},
    "initial_state": {"joints": [0.1, 0.2], "velocities": [0.1, 0.2], "offset": [0.01, 0.02],
                      "velocity_offset": [0.01, 0.02]},
    "noise": {"position": 1e-4, "velocity": 1e-3, "period": 0.001},
    "control_period": 0.001, "duration": 2.0, "sample_period": 0.01, "saturate": False,
    "settling_tolerance": 1e-3, "relative_tolerance": 1e-8, "absolute_tolerance": 1e-10,
    "timeout": 5.0, "seed": 3, "motor_inertia": 0.1, "viscous_friction": [0.1, 0.2],
    "coulomb_friction": 0.3, "effort_limits": 20.0,
    "joint_stops": {"stiffness": 1e4, "dissipation": 2.0},
}  # fmt: skip
REFERENCES: list[dict[str, Any]] = [
    {"type": "hold", "joints": [0.1, 0.2], "duration": 2.0},
    {"type": "step", "from": [0.1, 0.2], "to": [0.3, 0.4], "at": 0.5, "duration": 2.0},
    {"type": "sine", "center": [0.1, 0.2], "amplitude": 0.3, "frequency": [0.5, 1.0],
     "phase": 0.1, "duration": 2.0},
    {"type": "spline", "points": [[0.1, 0.2], [0.3, 0.4]], "times": [0.0, 1.0],
     "interpolation": "natural_spline"},
]  # fmt: skip
_GAINS = {"natural_frequency": 10.0, "damping": 1.0}
CONTROLLERS: list[dict[str, Any]] = [
    {"type": "independent_joint", "Kp": 1.0, "Kd": [1.0, 2.0], "inertia": 0.1,
     "motors": [MOTOR]} | _GAINS,
    {"type": "computed_torque", "Kp": 1.0, "Kd": 2.0} | _GAINS,
    {"type": "pd_gravity", "Kp": [[1.0, 0.0], [0.0, 1.0]], "Kd": 2.0} | _GAINS,
    {"type": "passivity", "Lambda": 1.0, "K": 2.0} | _GAINS,
    {"type": "adaptive", "Lambda": 1.0, "K": 2.0, "Gamma": 0.5, "estimate": [0.1, 0.2],
     "motors": True, "known_zeros": True, "parameters": ["m1"]} | _GAINS,
]  # fmt: skip


_POSE = {"position": [0.4, 0.0, 0.3], "frame": "base"}
_BOX = {"type": "box", "size": [0.1, 0.1, 0.1]}
_GOALS: list[dict[str, Any]] = [
    {"id": "a", "joints": [0.1, 0.2], "dwell": 0.5, "group": "left"},
    {"pose": _POSE, "frame": "tool", "position_tolerance": 1e-3, "orientation_tolerance": 1e-2,
     "tolerance": {"free": ["rz"], "samples": 4}},
    {"state": "home"},
    {"any_of": [{"joints": [0.3, 0.4]}, {"pose": _POSE}]},
]  # fmt: skip

TOURS: list[tuple[type[BaseModel], dict[str, Any]]] = [
    (TourRequest, {
        "tool": "gripper_a", "tcp": "tip", "margins": MARGINS,
        "robot": "arm", "scene": "table", "frame": "base", "start": {"joints": [0.0, 0.1]},
        "end": {"state": "home"}, "goals": _GOALS, "precedence": [["a", "1"], ["left", "3"]],
        "attached": [{"id": "drill", "shape": _BOX, "pose": {"position": [0.0, 0.0, 0.1]},
                      "link": "hand"}],
        "allowed_collisions": [["hand", "table"]], "margin": 0.01,
        "clearance": {"preferred": 0.02, "least": 0.01}, "start_state_tolerance": 1e-5,
        "timing": {"method": "jerk_limited", "velocity_scaling": 0.5},
        "limits": {"velocity": [1.0, 1.0]}, "rounds": 3, "leg_timeout": 1.0,
        "goal_costs": {"turns": 1.0}, "stops": "both", "witness": True,
        "allow_partial": True, "timeout": 5.0, "seed": 7, "keep": True,
        "constraints": [{"type": "clearance", "margin": 0.01}]}),
    (TourRequest, {"robot": "arm", "start": {"state": "home"}, "end": "start",
                   "goals": _GOALS[:2]}),
]  # fmt: skip


BUNDLE: dict[str, Any] = {
    "armwright_bundle": 1,
    "operation": "POST /v1/plan",
    "version": "0.1.0",
    "status": "succeeded",
    "seed": 1,
    "digest": "0" * 64,
    "robot": "arm",
    "robot_document": "{}",
    "scene": "table",
    "scene_document": "{}",
    "request": "{}",
    "answer": "{}",
}
KEPT_PLANS: list[tuple[type[BaseModel], Any]] = [
    (StopRequest, {"at": 0.5, "kind": "joints", "timeout": 5.0}),
    (ReplayRequest, {"changes": {"margin": 0.1}, "documents": "current", "keep_replay": True}),
    (Bundle, BUNDLE),
]


PREMISES = {"robot": "panda", "robot_hash": "0a" * 32, "scene": "table", "scene_hash": "1b" * 32,
            "obstacles": 2, "attached": ["part"], "tool": "hand", "margin": 0.01,
            "open_meshes": ["sheet"]}  # fmt: skip
POSE = {"position": [0.4, 0.0, 0.3]}
CORNERS = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]
SHAPES: list[dict[str, Any]] = [
    {"type": "box", "size": [0.1, 0.2, 0.3]},
    {"type": "sphere", "radius": 0.1},
    {"type": "cylinder", "radius": 0.1, "height": 0.2},
    {"type": "capsule", "radius": 0.1, "height": 0.2},
    {"type": "cone", "radius": 0.1, "height": 0.2},
    {"type": "halfspace", "normal": [0.0, 0.0, 1.0], "offset": -0.2},
    {"type": "convex", "vertices": CORNERS},
    {"type": "mesh", "vertices": CORNERS, "faces": [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]},
    {"type": "mesh", "stl_base64": "AAAA"},
    {
        "type": "point_cloud",
        "points": [[0.5, 0.0, 0.2]],
        "radius": 0.01,
        "except": [{"object": "o0", "margin": 0.01}],
    },
]
ORIENTATIONS: list[dict[str, Any]] = [
    {"quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]},
    {"rotation_matrix": IDENTITY},
    {"euler_zyz": [0.1, 0.2, 0.3]},
    {"rpy": [0.1, 0.2, 0.3]},
    {"axis_angle": [0.0, 0.0, 1.0, 0.5]},
]
TRANSFORM = np.eye(4).tolist()
OBSTACLES = [
    {"id": f"o{i}", "shape": shape, "margin": 0.01, "pose": POSE | ORIENTATIONS[i % 5]}
    for i, shape in enumerate(SHAPES)
]
OBSTACLES[0]["pose"] = {"transform": TRANSFORM}
SCENE: dict[str, Any] = {
    "name": "table",
    "frame": "base",
    "obstacles": [*OBSTACLES[:-1], OBSTACLES[-1] | {"pose": POSE | {"frame": "base"}}],
    "allowed_collisions": [["hand", "o0"], {"pair": ["hand", "o1"], "touch_depth": 0.002}],
}
ATTACHED: list[dict[str, Any]] = [
    {
        "id": "part", "shape": SHAPES[0], "pose": POSE, "link": "hand", "touch_links": ["finger"],
        "touch_depth": 0.002, "mass": 0.5, "center_of_mass": [0.0, 0.0, 0.1], "inertia": IDENTITY,
    },
    {"id": "o1", "grasp_joints": [0.1, 0.2], "link": "hand"},
]  # fmt: skip
_LINK = {"link": "hand", "reference_link": "base", "frame": "base", "weight": 1.0}
REGIONS: list[dict[str, Any]] = [
    {"type": "box", "pose": POSE, "size": [0.1, 0.0, 0.1]},
    {"type": "sphere", "center": [0.4, 0.0, 0.3], "radius": 0.05},
    {"type": "plane", "point": [0.4, 0.0, 0.3], "normal": [0.0, 0.0, 1.0], "tolerance": 0.002},
    {"type": "line", "point": [0.4, 0.0, 0.3], "direction": [0.0, 1.0, 0.0], "tolerance": 0.002,
     "length": 0.5},
]  # fmt: skip
CONSTRAINTS: list[dict[str, Any]] = [
    {"type": "joint", "joint": "j1", "position": 0.1, "tolerance_above": 0.2,
     "tolerance_below": 0.3, "weight": 2.0},
    *({"type": "position", "point": [0.0, 0.0, 0.1], "region": r} | _LINK for r in REGIONS),
    {"type": "orientation", "axis": [0.0, 0.0, 1.0], "direction": [0.0, 0.0, -1.0],
     "cone_angle": 0.2} | _LINK,
    {"type": "orientation", "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0], "axis_tolerances": 0.1},
    {"type": "look_at", "axis": [0.0, 0.0, 1.0], "target": [0.6, 0.0, 0.1], "angle": 0.05,
     "point": [0.0, 0.0, 0.1]} | _LINK,
    {"type": "clearance", "margin": 0.02},
    {"type": "relative_pose", "pose": POSE, "position_tolerance": 0.01,
     "orientation_tolerance": [0.1, 0.2, 0.3]} | _LINK,
    {"type": "tool_speed", "limit": 0.25},
    {"type": "torque", "limits": [10.0, 20.0]},
]  # fmt: skip
MODEL: dict[str, Any] = {
    "tool": "gripper_a",
    "tcp": "tip",
    "margins": MARGINS,
    "gravity": [0.0, 0.0, -9.81],
    "payload": PAYLOAD,
    "motor_inertia": [0.1, 0.2],
    "viscous_friction": 0.3,
    "coulomb_friction": 0.2,
}
TIMING: dict[str, Any] = {
    "method": "spline", "solver": "toppra", "velocity_scaling": 0.5, "acceleration_scaling": 0.4,
    "jerk_scaling": 0.3, "times": [0.0, 1.0], "scale_times": True, "interpolation": "linear",
    "blend_tolerance": 0.01, "torque_limits": True, "payload": PAYLOAD, "tool_speed": 0.5,
    "sample_period": 0.01, "sample_count": 5, "duration": 2.0, "at_least": True,
}  # fmt: skip
LIMITS = {name: [1.0, 2.0] for name in ("velocity", "acceleration", "jerk", "effort")}
FRAME = {"frame": "tool"}
RATES = {"velocities": [0.1, 0.2], "accelerations": [0.3, 0.4]}
MOTIONS: list[dict[str, Any]] = [
    {"type": "lin", "pose": POSE, "blend": 0.0, "rotation": "longer"},
    {"type": "circ", "pose": POSE, "via": [0.4, 0.1, 0.3]},
    {"type": "circ", "pose": POSE, "center": [0.4, 0.1, 0.3], "normal": [0.0, 0.0, 1.0]},
]
TOOL_MOTIONS = {
    "motions": [
        MOTIONS[0] | {"start": POSE, "part": "approach"},
        MOTIONS[1] | {"part": "seam", "begins": 1.5,
                      "tolerance": {"x": [-0.001, 0.001], "tilt": 0.1}, "tool_speed": 0.05},
        MOTIONS[2] | {"part": "seam"},
        {"type": "corner", "pose": POSE,
         "rounds": {"pose": POSE, "slope": 2.0,
                    "before": {"center": [0.4, 0.1, 0.3], "normal": [0.0, 0.0, 1.0]},
                    "after": {"center": [0.5, 0.1, 0.3], "normal": [0.0, 0.0, 1.0]}}},
    ],
    "begins": 0.5, "ends": [1.0, 2.0, 3.0, 4.0], "max_deviation": 1e-3,
    "max_orientation_deviation": 1e-2, "orientation": "free",
    "tolerance": {"free": ["rz"]}, "tool_speed": 0.1, "speed_band": 0.2,
}  # fmt: skip
#: Most requests refer to these; one of each kind has them in full.
SMALL_SCENE = {"obstacles": OBSTACLES[1:2]}
ABOUT: dict[str, Any] = {
    "tool": "gripper_a",
    "tcp": "tip",
    "margins": MARGINS,
    "attached": ATTACHED[1:],
    "allowed_collisions": [["hand", "o0"]],
}
PLAN: dict[str, Any] = ABOUT | {
    "robot": "panda", "fingers": {"claw": 0.01}, "scene": SMALL_SCENE, "frame": "base",
    "start": {"joints": [0.0, 0.1]} | RATES,
    "goal": {"joints": [0.5, 0.6]} | RATES, "planner": "rrt_connect",
    "planner_options": {"range": 0.5}, "constraints": CONSTRAINTS[:1], "margin": 0.01,
    "keep": False, "clearance": {"preferred": 0.03, "least": 0.01},
    "goal_costs": {"motion_time": 2.0, "joint_limits": 0.4, "manipulability": 0.3,
                   "clearance": 0.2, "turns": 0.1},
    "collisions": "ignore", "start_state_tolerance": 1e-5, "timing": TIMING, "limits": LIMITS,
    "stops": "both", "witness": True, "timeout": 5.0, "seed": 3,
    "refine": {"objective": {"time": 1.0, "jerk": 1e-6}, "duration": 3.0, "degree": 5,
               "control_points": 16, "rounds": 12, "solver": "ipopt"},
}  # fmt: skip
BRIEF: dict[str, Any] = {
    "robot": "panda",
    "start": {"joints": [0.0, 0.1]},
    "goal": {"joints": [0.5, 0.6]},
}
POSE_GOAL = {
    "pose": POSE,
    "frame": "base",
    "position_tolerance": 0.01,
    "orientation_tolerance": 0.02,
}
SEGMENTS = {
    "joint_names": ["j1", "j2"], "duration": 1.0,
    "segments": [{"t0": 0.0, "t1": 1.0, "coefficients": [[0.0, 1.0], [0.5]]}],
}  # fmt: skip
SAMPLES: dict[str, Any] = {
    "samples": {"time": [0.0, 1.0], "position": [[0.0, 0.0], [1.0, 1.0]],
                "velocity": [[0.0, 0.0], [0.0, 0.0]], "acceleration": [[0.0, 0.0], [0.0, 0.0]]},
    "interpolation": "quintic",
}  # fmt: skip
DH_ROW: dict[str, Any] = {
    "type": "revolute", "a": 0.5, "alpha": 0.0, "d": 0.0, "theta": 0.0, "lower": -3.0, "upper": 3.0,
    "velocity": 2.0, "acceleration": 5.0, "jerk": 50.0, "effort": 10.0, "mass": 1.0,
    "center_of_mass": [0.0, 0.0, 0.1], "inertia": IDENTITY, "motor_inertia": 0.1,
    "viscous_friction": 0.2, "coulomb_friction": 0.1, "beta": 0.0, "continuous": False,
    "geometry": [{"shape": SHAPES[0], "pose": POSE}],
}  # fmt: skip
DRIVEN_ROW: dict[str, Any] = {
    "type": "revolute", "a": 0.5, "alpha": 0.0, "d": 0.0, "theta": 0.0, "motor": MOTOR,
}  # fmt: skip
JOINT_LIMITS = {
    "joint_1": {
        "lower": -1.0,
        "upper": 2.0,
        "velocity": 1.0,
        "acceleration": 2.0,
        "jerk": 3.0,
        "effort": 4.0,
    },
    "*": {"jerk": 5.0},
}
DEFAULT_LIMITS = {"acceleration": "10 x velocity", "jerk": "10 x acceleration"}
BATCH = {name: value for name, value in PLAN.items() if name != "keep"}
IK: dict[str, Any] = ABOUT | {
    "attached": ATTACHED,
    "pose": POSE | {"frame": "tool"}, "frame": "base", "link": "hand", "seed_joints": [0.0, 0.1],
    "method": "gradient",
    "all_solutions": True, "all_turns": True, "max_solutions": 8, "choice": "limits",
    "parameters": [0.1], "axes": ["x", "rz"], "scene": "table", "constraints": CONSTRAINTS,
    "posture": [0.1, 0.2], "timeout": 5.0, "seed": 3, "keep": True,
    "gradient": {"rule": "transpose", "coordinates": "zyz", "gain": 0.5, "steps": 100,
                 "form": "flow", "trace": True, "trace_points": 50, "duration": 0.3},
}  # fmt: skip

SOLIDS = [{"shape": SHAPES[0], "pose": POSE}]
TOOL: dict[str, Any] = {
    "name": "gripper_a", "link": "hand", "tcp": {"tip": POSE}, "solids": SOLIDS, "mass": 0.5,
    "center_of_mass": [0.0, 0.0, 0.1], "inertia": IDENTITY, "grip": "jaws",
    "opening": [0.0, 0.1], "speed": 0.1,
    "fingers": {"left": {"type": "prismatic", "pose": POSE, "axis": [1.0, 0.0, 0.0],
                         "travel": 0.5, "solids": SOLIDS}},
}  # fmt: skip
_FINGER = {"finger_length": 0.05, "finger_width": 0.02, "finger_thickness": 0.01}
_GRIPPER = {"opening": 0.1, "height": 0.1, "speed": 0.1, "mass": 1.0} | _FINGER
FORMS: list[dict[str, Any]] = [
    {"type": "parallel_jaw", "width": 0.1, "depth": 0.05} | _GRIPPER,
    {"type": "three_jaw", "radius": 0.05} | _GRIPPER,
    {"type": "suction_cup", "radius": 0.02, "height": 0.03, "stem_radius": 0.01,
     "stem_length": 0.1, "mass": 0.2},
    {"type": "torch", "radius": 0.02, "length": 0.2, "neck_radius": 0.01, "neck_length": 0.1,
     "angle": 0.5, "stick_out": 0.01, "mass": 1.0},
    {"type": "spindle", "radius": 0.04, "length": 0.2, "bit_radius": 0.003, "bit_length": 0.05,
     "mass": 2.0},
]  # fmt: skip
#: What requests that may mount a tool have for it.
MOUNTED = {"tool": "gripper_a", "tcp": "tip", "margins": MARGINS}

FULL: list[tuple[type[BaseModel], dict[str, Any]]] = [
    (NamedTool, TOOL),
    *((kind, {"link": "hand", "name": "it", "form": form})
      for kind in (Tool, NamedTool) for form in FORMS),
    (FkRequest, {"joints": [0.0, 0.1], "tool": TOOL,
                 "tcp": {"object": "part", "pose": POSE}}),
    (NamedScene, SCENE),
    (NamedScene, {"name": "table", "moveit": "name: x"}),
    (ProjectRequest, {"points": [[0.5, 0.0, 0.4]], "engine": "fcl"}),
    (CheckRequest, ABOUT | {"robot": "panda", "scene": SMALL_SCENE, "keep": True,
                            "fingers": {"claw": 0.01},
                            "joints": [[0.0, 0.1], [0.2, 0.3]], "margin": 0.01, "timeout": 5.0,
                            "frame": "base", "depth": False}),
    (FkRequest, MOUNTED | {"joints": [0.0, 0.1], "link": "hand", "orientation": "rpy",
                 "frame": "base", "fingers": {"claw": 0.01}}),
    (FkRequest, {"joints": [[0.0, 0.1], [0.2, 0.3]], "fingers": {"claw": [0.0, 0.01]}}),
    (JacobianRequest, MOUNTED | {"joints": [0.0, 0.1], "link": "hand", "point": [0.0, 0.0, 0.1],
                       "kind": "analytic_zyz", "frame": "tool", "axes": ["x", "rz"]}),
    (IkRequest, IK),
    (IkRequest, {"poses": [POSE | orientation for orientation in ORIENTATIONS]}),
    (VelocityRequest, {"joints": [0.0, 0.1], "joint_velocities": [0.1, 0.2]}),
    (VelocityRequest, MOUNTED | {"joints": [0.0, 0.1], "twist": [0.1] * 6, "nullspace": [0.1, 0.2],
                       "link": "hand", "point": [0.0, 0.0, 0.1], "damped_below": 0.01,
                       "frame": "tool"}),
    (VelocityRequest, {"joints": [0.0, 0.1], "twist": [0.1, 0.2], "axes": ["x", "y"]}),
    (WrenchRequest, {"joints": [0.0, 0.1], "torques": [1.0, 2.0], "axes": ["x", "y"]}),
    (WrenchRequest, MOUNTED | {"joints": [0.0, 0.1], "wrench": [1.0] * 6, "link": "hand",
                     "point": [0.0, 0.0, 0.1], "frame": "tool"}),
    (DynamicsRequest, MODEL | FRAME | RATES | {"joints": [0.0, 0.1], "wrench": [1.0] * 6,
                                       "christoffel_symbols": True, "partial_jacobians": True}),
    (ForwardDynamicsRequest, MODEL | FRAME | {
        "joints": [0.0, 0.1], "velocities": [0.1, 0.2], "torques": [0.1, 0.2],
        "wrench": [1.0] * 6}),
    (RegressorRequest, MODEL | FRAME | RATES | {
        "joints": [0.0, 0.1], "motors": True, "known_zeros": True,
        "reference_velocities": [0.1, 0.2]}),
    (ExportRequest, ABOUT | {"robot": "panda", "trajectory": SEGMENTS, "scene": "table",
                             "frame": "base", "format": "csv", "sample_period": 0.01,
                             "sample_count": 9, "least_spacing": 0.02,
                             "interpolation": "cubic", "path_tolerance": 0.01, "blend": 0.1,
                             "speed": 0.5, "name": "moves", "frame_id": "world", "margin": 0.01,
                             "fingers": {"finger": 0.01}, "premises": PREMISES,
                             "different_scene": True, "timeout": 5.0}),
    (ExportRequest, {"plan": {"operation": "POST /v1/tasks", "request": {}, "answer": {}},
                     "format": "krl", "ports": {"spindle": "ao2"}, "gripper": "grip"}),
    *KEPT_PLANS,
    *tasks(POSE, CONSTRAINTS[:1]), *TOURS,
    (ReachRequest, ABOUT | {"poses": [POSE], "link": "hand", "frame": "base", "margin": 0.01,
                            "tolerance": {"free": ["rz"], "rx": [-0.1, 0.1], "ry": [0.0, 0.1],
                                          "x": [0.0, 0.1], "y": [0.0, 0.1], "z": [0.0, 0.1],
                                          "samples": 2},
                            "scene": "table", "choice": "limits", "clearance": False,
                            "joints": True, "format": "json", "timeout": 5.0, "seed": 3}),
    (ReachRequest, {"box": {"size": [1.0, 1.0, 0.0], "pose": POSE, "spacing": 0.1,
                            "orientations": [[0.0, 0.0, 0.0, 1.0]]},
                    "bases": [POSE]}),
    (ReachRequest, {"poses": [POSE], "tolerance": {"rz": [0.0, 0.1]},
                    "base_region": {"x": [0.0, 1.0], "y": [0.0, 1.0], "z": 0.1, "spacing": 0.5,
                                    "yaws": 2}}),
    (PotentialRequest, MOUNTED | {"joints": [0.0, 0.1], "goal_joints": [0.5, 0.6],
                        "scene": SMALL_SCENE, "engine": "fcl", "timeout": 5.0, "frame": "base",
                        "options": {"attractive_weights": [1.0, 2.0], "attractive_cap": 0.2,
                                    "repulsive_weights": 1e-4, "influence_distance": 0.1,
                                    "least_distance": 1e-3, "preset": "notes",
                                    "control_points": "origins", "point_radii": [0.1, 0.2],
                                    "joint_weight": 0.1}}),
    (PotentialRequest, {"joints": [0.0, 0.1], "goal_joints": [0.5, 0.6], "options": {
        "control_points": [{"link": "hand", "point": [0.0, 0.0, 0.1]}]}}),
    (PlanRequest, PLAN),
    (PlanRequest, BRIEF | {"goal": {"any_of": [POSE_GOAL, {"joints": [0.5, 0.6]}]}}),
    (PlanRequest, BRIEF | {"start": {"state": "home"}, "goal": {"state": "away"}}),
    (PlanRequest, BRIEF | {"start": {"plan": "plan_1", "at": 0.5}}),
    (PlanRequest, BRIEF | {"goal": {"any_of": [{"state": "away"}]}}),
    (PlanRequest, BRIEF | {"goal": POSE_GOAL, "planner": "cartesian",
                          "planner_options": {"motions": MOTIONS, "allow_partial": True}}),
    (BatchRequest, BATCH | {"problems": [BRIEF, {"goal": POSE_GOAL}]}),
    (ValidateRequest, ABOUT | {
        "fingers": {"claw": 0.01},
        "robot": "panda", "scene": SMALL_SCENE, "frame": "base", "trajectory": SAMPLES,
        "limits": LIMITS, "keep": True,
        "constraints": CONSTRAINTS[:1], "margin": 0.01, "collisions": "ignore",
        "tool_motions": TOOL_MOTIONS, "torque_limits": True, "payload": PAYLOAD, "tool_speed": 0.5,
        "stops": "joints", "witness": True, "timeout": 5.0}),
    (GuardRequest, ABOUT | {
        "robot": "panda", "scene": SMALL_SCENE, "frame": "base", "fingers": {"claw": 0.01},
        "margin": 0.01, "limits": LIMITS, "stop": "both", "tracking": 0.1, "arm": "left",
        "timeout": 5.0, "latency": 0.02, "scene_hash": "0" * 64, "exact": True,
        "state": {"positions": [0.0, 0.1], "velocities": [0.1, 0.2], "accelerations": [0.0, 0.1],
                  "elapsed": 0.1},
        "proposal": {"samples": [[0.0, 0.1]], "velocities": [[0.1, 0.2]],
                     "accelerations": [[0.0, 0.1]], "period": 0.1, "interpolation": "quintic"}}),
    (GuardRequest, {"robot": "panda", "state": {"positions": [0.0, 0.1]},
                    "proposal": {"trajectory": SAMPLES}}),
    (GuardChange, {"change": {"add": SMALL_SCENE["obstacles"], "remove": ["ball"],
                              "move": [{"id": "box", "pose": POSE}], "elapsed": 0.1}}),
    (GuardRequest, {"robot": "panda", "state": {"positions": [0.0, 0.1]},
                    "proposal": {"joint_velocities": [0.1, 0.2], "duration": 0.1}}),
    (GuardRequest, {"robot": "panda", "state": {"positions": [0.0, 0.1]},
                    "proposal": {"twist": [0.1, 0, 0, 0, 0, 0.2], "duration": 0.1,
                                 "link": "hand"}}),
    (RetimeRequest, MOUNTED | {
        "path": {"joints": [[0.0, 0.1], [0.2, 0.3]], "knots": [0.0, 1.0],
                 "joint_names": ["a", "b"], "tolerance": 1e-3},
        "robot": "panda", "limits": LIMITS, "stops": "path", "timeout": 5.0,
        "limits_at": [{"from": 0, "to": 0.1, "by": "length", "velocity": [0.1, 0.2],
                       "acceleration": [1.0, 2.0], "tool_speed": 0.1}],
        "timing": TIMING | {"start_velocity": [0.1, 0.2], "end_velocity": [0.1, 0.2],
                            "velocities": [[0.1, 0.2], [0.0, 0.0]]}}),
    (FitRequest, {"samples": {name: [[0.1], [0.2]] for name in ("position", "velocity",
                                                                "acceleration")}
                  | {"time": [0.0, 1.0]}, "joint_names": ["a"], "robot": "panda", "rest": True,
                  "tolerance": 1e-3, "timeout": 5.0} | MOUNTED),
    (SimplifyRequest, ABOUT | {
        "robot": "panda", "scene": SMALL_SCENE, "frame": "base", "fingers": {"claw": 0.01},
        "margin": 0.01, "timeout": 5.0,
        "path": {"joints": [[0.0, 0.1], [0.2, 0.3]], "joint_names": ["a", "b"]},
        "tolerance": 1e-3, "tool_tolerance": {"position": 1e-3, "orientation": 0.01}}),
    (RetimeRequest, {
        "from": {"position": [0.0, 0.1], "velocity": [0.1, 0.2], "acceleration": [0.0, 0.1]},
        "to": {"position": [0.2, 0.3], "velocity": [0.1, 0.2], "acceleration": [0.0, 0.1]},
        "joint_names": ["a", "b"], "synchronization": "time", "robot": "panda", "limits": LIMITS,
        "timing": {"method": "jerk_limited", "jerk_scaling": 0.5, "sample_period": 0.01},
        "timeout": 5.0}),
    (ConvertPoseRequest, {"pose": {"transform": np.eye(4).tolist()}, "inverse": True,
                          "angular_velocity": [0.0, 0.1, 0.2]}),
    (ConvertPoseRequest, {"motions": [POSE | orientation | {"about": "fixed"}
                                      for orientation in ORIENTATIONS]}),
    (ConvertPoseRequest, {"motions": [{"transform": np.eye(4).tolist()}],
                          "rotation_rate": np.zeros((3, 3)).tolist()}),
    (LyapunovRequest, {"A": [[0.0, 1.0], [-1.0, -1.0]], "P": [[1.0, 0.5], [0.5, 1.0]],
                       "x": [0.5, 0.0]}),
    (LyapunovRequest, {"A": [[-1.0]], "Q": [[1.0]], "x": [[1.0], [2.0]]}),
    (LyapunovRequest, {"f": ["-x1"], "V": "x1**2", "x": [1.0]}),
    (LyapunovRequest, {"system": "pendulum",
                       "parameters": {"mass": 1.0, "length": 0.5, "gravity": 9.8, "damping": 0.1}}),
    (ConvertRequest, {"trajectory": SEGMENTS, "sample_period": 0.01, "format": "csv",
                      "frame_id": "base"}),
    (SimulateRequest, ABOUT | SIMULATE | {"trajectory": SEGMENTS, "controller": CONTROLLERS[0]}),
    *((SimulateRequest, {"robot": "panda", "trajectory": SEGMENTS, "controller": controller})
      for controller in CONTROLLERS[1:]),
    *((SimulateRequest, {"robot": "panda", "reference": reference, "controller": CONTROLLERS[1],
                         "motors": MOTOR})
      for reference in REFERENCES),
    (RobotBody, {"name": "arm", "joint_limits": JOINT_LIMITS, "base_link": "base", "tip_link": "t",
                 "dh": {"convention": "standard", "rows": [DH_ROW], "base": POSE, "tool": POSE,
                        "gravity": [0.0, 0.0, -9.81], "geometry": {"capsules": 0.05}}}),
    (RobotBody, {"name": "arm", "dh": {"convention": "modified", "rows": [DRIVEN_ROW]}}),
    (RobotBody, {"name": "arm", "urdf": "<robot/>", "srdf": "<robot/>", "meshes": {"a.stl": "AAAA"},
                 "joint_limits": JOINT_LIMITS, "default_limits": DEFAULT_LIMITS,
                 "held": {"finger": 0.1}, "allow_suspected": True, "visual_solids": True,
                 "motors": {"*": MOTOR}, "inertias": INERTIAS,
                 "tools": [{"name": "torch_a", "form": {"type": "torch"}}],
                 "calibration": CALIBRATION}),
    (RobotChanges, {"joint_limits": JOINT_LIMITS, "default_limits": DEFAULT_LIMITS,
                    "inertias": INERTIAS, "calibration": CALIBRATION}),
    (ArchiveFields, {"name": "arm", "urdf_path": "a/arm.urdf", "srdf_path": "arm.srdf",
                     "joint_limits": "joint_limits: {}", "default_limits": DEFAULT_LIMITS,
                     "held": {"finger": 0.1}, "base_link": "base", "tip_link": "tip",
                     "allow_suspected": True, "visual_solids": True, "motors": {"joint_1": MOTOR},
                     "tools": [{"name": "torch_a", "form": {"type": "torch"}}],
                     "inertias": INERTIAS, "calibration": "kinematics: {}"}),
    *((CalibrateRequest, MOUNTED | {"joints": [[0.1, 0.2]],
                          "link": "hand", "unknown": ["frame", "tip"], "timeout": 5.0,
                          "noise": ACCURACY, "tolerance": ACCURACY} | measured)
      for measured in MEASURED),
    (ExcitationRequest, ABOUT | {
        "scene": SMALL_SCENE, "frame": "base", "fingers": {"claw": 0.01}, "margin": 0.01,
        "start": [0.1, 0.2], "period": 5.0, "harmonics": 4, "drives": ["offset"],
        "velocity_scaling": 0.5, "acceleration_scaling": 0.5, "evaluations": 9,
        "sample_period": 0.01, "seed": 3, "timeout": 5.0}),
    (IdentifyRequest, MOUNTED | {"find": "payload", "link": "hand",
                       "drives": ["offset"], "cutoff": 10.0, "timeout": 5.0,
                       "logs": [LOG | {"times": [0.0, 0.1], "torques": [[0.1], [0.2]]},
                                LOG | {"period": 0.1, "currents": [[0.1], [0.2]],
                                       "gains": [50.0]}]}),
]  # fmt: skip
NAMES = [f"{model.__name__}-{i}" for i, (model, _) in enumerate(FULL)]
