"""Armwright as a library: robots, scenes, plans and proofs from Python, without the server.

>>> import armwright as aw
>>> robot = aw.load_robot("panda")
>>> scene = aw.Scene([aw.Obstacle("post", aw.Box((0.1, 0.1, 1.0)), aw.pose([0.5, 0.0, 0.5]))])
>>> result = aw.plan(robot, scene, start, goal)

Names are imported when they are first used, so that importing this package costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from armwright.shadowing import check_packages

if TYPE_CHECKING:
    from armwright.checker import Checker
    from armwright.configuration import check, ik
    from armwright.model import (
        Dynamics,
        dynamics,
        equations,
        fk,
        inverse_dynamics,
        jacobian,
        pose,
    )
    from armwright.motion import (
        certify,
        certify_stops,
        plan,
        plan_seam,
        retime,
        retime_states,
        simplify,
        simulate,
        stop,
    )
    from armwright.robot import load_robot
    from kinematics.errors import ArmwrightError
    from kinematics.ik.solution import IkResult, IkSolution
    from kinematics.model.chain import Chain
    from kinematics.model.dh_table import DhRow, DhTable
    from kinematics.robots import builtin_names
    from kinematics.trajectory.trajectory import Trajectory
    from obstacles.robots.attachment import Attachment, Holding, grasp, hold, release
    from obstacles.robots.finger_geometry import with_fingers
    from obstacles.robots.grasps import GraspSearch, JawSpan, find_grasps, jaw_span
    from obstacles.robots.robot_geometry import RobotGeometry
    from obstacles.robots.tool import Jaw, Solid, Tool, mount, with_tip
    from obstacles.robots.tool_forms import built_in_tool
    from obstacles.scenes.moveit import scene_from_moveit
    from obstacles.scenes.placement import place
    from obstacles.scenes.scene import AllowedContact, Obstacle, Scene
    from obstacles.shapes.shape import (
        Box,
        Capsule,
        Compound,
        Cone,
        Convex,
        Cylinder,
        HalfSpace,
        Mesh,
        PointCloud,
        Sphere,
    )
    from planning.configuration_check import ConfigurationReport
    from planning.constraints.kinds.joint import JointConstraint
    from planning.constraints.kinds.limit import (
        ClearanceConstraint,
        ToolSpeedConstraint,
        TorqueConstraint,
    )
    from planning.constraints.kinds.look_at import LookAtConstraint
    from planning.constraints.kinds.orientation import ConeConstraint, OrientationConstraint
    from planning.constraints.kinds.position import PositionConstraint
    from planning.constraints.kinds.region import BoxRegion, LineRegion, PlaneRegion, SphereRegion
    from planning.constraints.kinds.relative_pose import RelativePoseConstraint
    from planning.exports.export import Export, export
    from planning.exports.options import ExportFormat, ExportOptions
    from planning.exports.swept_volume import SweptVolume, swept_volume
    from planning.options import Options
    from planning.problem import JointGoal, PoseGoal, Problem
    from planning.proof.certificate import Certificate
    from planning.reach.evaluation import BasePlacement, Reach, ReachOptions, place_base, reach
    from planning.reach.grid import PoseGrid
    from planning.reach.tolerance import Tolerance
    from planning.result import Failure, Plan
    from planning.retiming.retime import Retimed
    from planning.retiming.simplify import SimplifiedPath
    from planning.sequence.result import SequenceFailure, SequencePlan, StagePlan, TaskOptions
    from planning.sequence.search import plan_task
    from planning.sequence.stage import (
        Attach,
        Detach,
        Grasp,
        Gripper,
        Load,
        Move,
        Place,
        StageSettings,
        Straight,
        Wait,
    )
    from planning.sequence.target import grasp_region, place_region
    from planning.sequence.task import Task
    from planning.sequence.world import Held, World
    from planning.stops.certificate import StopCertificate, Surroundings
    from planning.stops.stop_motion import Stop
    from planning.timing.jerk.state_to_state import JointState
    from planning.timing.options import TimingOptions
    from planning.tool_motions.tool_tolerance import (
        SeamOptions,
        SeamWaypoint,
        StraightOffset,
        ToolTolerance,
    )
    from planning.tours.planner import plan_tour
    from planning.tours.problem import TourGoal, TourOptions, TourProblem
    from planning.tours.result import Tour
    from planning.values.goal_costs import GoalCosts
    from planning.values.limits import MotionLimits
    from planning.values.preferred_clearance import PreferredClearance
    from planning.values.search_trees import Explored
    from planning.witness.witness import witness
    from tracking.controllers.adaptive import Adaptive
    from tracking.controllers.computed_torque import ComputedTorque
    from tracking.controllers.independent_joint import IndependentJoint
    from tracking.controllers.passivity import Passivity
    from tracking.controllers.pd_gravity import PdGravity
    from tracking.controllers.quadratic_form import quadratic_lyapunov, solve_lyapunov

#: Module that each public name is imported from.
_MODULES = {
    "Adaptive": "tracking.controllers.adaptive",
    "AllowedContact": "obstacles.scenes.scene",
    "ArmwrightError": "kinematics.errors",
    "Attach": "planning.sequence.stage",
    "Attachment": "obstacles.robots.attachment",
    "BasePlacement": "planning.reach.evaluation",
    "Box": "obstacles.shapes.shape",
    "BoxRegion": "planning.constraints.kinds.region",
    "Capsule": "obstacles.shapes.shape",
    "Certificate": "planning.proof.certificate",
    "Chain": "kinematics.model.chain",
    "Checker": "armwright.checker",
    "ClearanceConstraint": "planning.constraints.kinds.limit",
    "Compound": "obstacles.shapes.shape",
    "ComputedTorque": "tracking.controllers.computed_torque",
    "Cone": "obstacles.shapes.shape",
    "ConeConstraint": "planning.constraints.kinds.orientation",
    "ConfigurationReport": "planning.configuration_check",
    "Convex": "obstacles.shapes.shape",
    "Cylinder": "obstacles.shapes.shape",
    "Detach": "planning.sequence.stage",
    "DhRow": "kinematics.model.dh_table",
    "DhTable": "kinematics.model.dh_table",
    "Dynamics": "armwright.model",
    "Explored": "planning.values.search_trees",
    "Export": "planning.exports.export",
    "ExportFormat": "planning.exports.options",
    "ExportOptions": "planning.exports.options",
    "Failure": "planning.result",
    "GoalCosts": "planning.values.goal_costs",
    "Grasp": "planning.sequence.stage",
    "GraspSearch": "obstacles.robots.grasps",
    "Gripper": "planning.sequence.stage",
    "HalfSpace": "obstacles.shapes.shape",
    "Held": "planning.sequence.world",
    "Holding": "obstacles.robots.attachment",
    "IkResult": "kinematics.ik.solution",
    "IkSolution": "kinematics.ik.solution",
    "IndependentJoint": "tracking.controllers.independent_joint",
    "Jaw": "obstacles.robots.tool",
    "JawSpan": "obstacles.robots.grasps",
    "JointConstraint": "planning.constraints.kinds.joint",
    "JointGoal": "planning.problem",
    "JointState": "planning.timing.jerk.state_to_state",
    "LineRegion": "planning.constraints.kinds.region",
    "Load": "planning.sequence.stage",
    "LookAtConstraint": "planning.constraints.kinds.look_at",
    "Mesh": "obstacles.shapes.shape",
    "MotionLimits": "planning.values.limits",
    "Move": "planning.sequence.stage",
    "Obstacle": "obstacles.scenes.scene",
    "Options": "planning.options",
    "OrientationConstraint": "planning.constraints.kinds.orientation",
    "Passivity": "tracking.controllers.passivity",
    "PdGravity": "tracking.controllers.pd_gravity",
    "Place": "planning.sequence.stage",
    "Plan": "planning.result",
    "PlaneRegion": "planning.constraints.kinds.region",
    "PointCloud": "obstacles.shapes.shape",
    "PoseGoal": "planning.problem",
    "PoseGrid": "planning.reach.grid",
    "PositionConstraint": "planning.constraints.kinds.position",
    "PreferredClearance": "planning.values.preferred_clearance",
    "Problem": "planning.problem",
    "Reach": "planning.reach.evaluation",
    "ReachOptions": "planning.reach.evaluation",
    "RelativePoseConstraint": "planning.constraints.kinds.relative_pose",
    "Retimed": "planning.retiming.retime",
    "RobotGeometry": "obstacles.robots.robot_geometry",
    "Scene": "obstacles.scenes.scene",
    "SeamOptions": "planning.tool_motions.tool_tolerance",
    "SeamWaypoint": "planning.tool_motions.tool_tolerance",
    "SequenceFailure": "planning.sequence.result",
    "SequencePlan": "planning.sequence.result",
    "SimplifiedPath": "planning.retiming.simplify",
    "Solid": "obstacles.robots.tool",
    "Sphere": "obstacles.shapes.shape",
    "SphereRegion": "planning.constraints.kinds.region",
    "StagePlan": "planning.sequence.result",
    "StageSettings": "planning.sequence.stage",
    "Stop": "planning.stops.stop_motion",
    "StopCertificate": "planning.stops.certificate",
    "Straight": "planning.sequence.stage",
    "StraightOffset": "planning.tool_motions.tool_tolerance",
    "Surroundings": "planning.stops.certificate",
    "SweptVolume": "planning.exports.swept_volume",
    "Task": "planning.sequence.task",
    "TaskOptions": "planning.sequence.result",
    "TimingOptions": "planning.timing.options",
    "Tolerance": "planning.reach.tolerance",
    "Tool": "obstacles.robots.tool",
    "ToolSpeedConstraint": "planning.constraints.kinds.limit",
    "ToolTolerance": "planning.tool_motions.tool_tolerance",
    "TorqueConstraint": "planning.constraints.kinds.limit",
    "Tour": "planning.tours.result",
    "TourGoal": "planning.tours.problem",
    "TourOptions": "planning.tours.problem",
    "TourProblem": "planning.tours.problem",
    "Trajectory": "kinematics.trajectory.trajectory",
    "Wait": "planning.sequence.stage",
    "World": "planning.sequence.world",
    "built_in_tool": "obstacles.robots.tool_forms",
    "builtin_names": "kinematics.robots",
    "certify": "armwright.motion",
    "certify_stops": "armwright.motion",
    "check": "armwright.configuration",
    "dynamics": "armwright.model",
    "equations": "armwright.model",
    "export": "planning.exports.export",
    "find_grasps": "obstacles.robots.grasps",
    "fk": "armwright.model",
    "grasp": "obstacles.robots.attachment",
    "grasp_region": "planning.sequence.target",
    "hold": "obstacles.robots.attachment",
    "ik": "armwright.configuration",
    "inverse_dynamics": "armwright.model",
    "jacobian": "armwright.model",
    "jaw_span": "obstacles.robots.grasps",
    "load_robot": "armwright.robot",
    "mount": "obstacles.robots.tool",
    "place": "obstacles.scenes.placement",
    "place_base": "planning.reach.evaluation",
    "place_region": "planning.sequence.target",
    "plan": "armwright.motion",
    "plan_seam": "armwright.motion",
    "plan_task": "planning.sequence.search",
    "plan_tour": "planning.tours.planner",
    "pose": "armwright.model",
    "quadratic_lyapunov": "tracking.controllers.quadratic_form",
    "reach": "planning.reach.evaluation",
    "release": "obstacles.robots.attachment",
    "retime": "armwright.motion",
    "retime_states": "armwright.motion",
    "scene_from_moveit": "obstacles.scenes.moveit",
    "simplify": "armwright.motion",
    "simulate": "armwright.motion",
    "solve_lyapunov": "tracking.controllers.quadratic_form",
    "stop": "armwright.motion",
    "swept_volume": "planning.exports.swept_volume",
    "with_fingers": "obstacles.robots.finger_geometry",
    "with_tip": "obstacles.robots.tool",
    "witness": "planning.witness.witness",
}

__all__ = [
    "Adaptive",
    "AllowedContact",
    "ArmwrightError",
    "Attach",
    "Attachment",
    "BasePlacement",
    "Box",
    "BoxRegion",
    "Capsule",
    "Certificate",
    "Chain",
    "Checker",
    "ClearanceConstraint",
    "Compound",
    "ComputedTorque",
    "Cone",
    "ConeConstraint",
    "ConfigurationReport",
    "Convex",
    "Cylinder",
    "Detach",
    "DhRow",
    "DhTable",
    "Dynamics",
    "Explored",
    "Export",
    "ExportFormat",
    "ExportOptions",
    "Failure",
    "GoalCosts",
    "Grasp",
    "GraspSearch",
    "Gripper",
    "HalfSpace",
    "Held",
    "Holding",
    "IkResult",
    "IkSolution",
    "IndependentJoint",
    "Jaw",
    "JawSpan",
    "JointConstraint",
    "JointGoal",
    "JointState",
    "LineRegion",
    "Load",
    "LookAtConstraint",
    "Mesh",
    "MotionLimits",
    "Move",
    "Obstacle",
    "Options",
    "OrientationConstraint",
    "Passivity",
    "PdGravity",
    "Place",
    "Plan",
    "PlaneRegion",
    "PointCloud",
    "PoseGoal",
    "PoseGrid",
    "PositionConstraint",
    "PreferredClearance",
    "Problem",
    "Reach",
    "ReachOptions",
    "RelativePoseConstraint",
    "Retimed",
    "RobotGeometry",
    "Scene",
    "SeamOptions",
    "SeamWaypoint",
    "SequenceFailure",
    "SequencePlan",
    "SimplifiedPath",
    "Solid",
    "Sphere",
    "SphereRegion",
    "StagePlan",
    "StageSettings",
    "Stop",
    "StopCertificate",
    "Straight",
    "StraightOffset",
    "Surroundings",
    "SweptVolume",
    "Task",
    "TaskOptions",
    "TimingOptions",
    "Tolerance",
    "Tool",
    "ToolSpeedConstraint",
    "ToolTolerance",
    "TorqueConstraint",
    "Tour",
    "TourGoal",
    "TourOptions",
    "TourProblem",
    "Trajectory",
    "Wait",
    "World",
    "built_in_tool",
    "builtin_names",
    "certify",
    "certify_stops",
    "check",
    "dynamics",
    "equations",
    "export",
    "find_grasps",
    "fk",
    "grasp",
    "grasp_region",
    "hold",
    "ik",
    "inverse_dynamics",
    "jacobian",
    "jaw_span",
    "load_robot",
    "mount",
    "place",
    "place_base",
    "place_region",
    "plan",
    "plan_seam",
    "plan_task",
    "plan_tour",
    "pose",
    "quadratic_lyapunov",
    "reach",
    "release",
    "retime",
    "retime_states",
    "scene_from_moveit",
    "simplify",
    "simulate",
    "solve_lyapunov",
    "stop",
    "swept_volume",
    "with_fingers",
    "with_tip",
    "witness",
]


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module 'armwright' has no attribute {name!r}")
    check_packages()
    value = getattr(import_module(_MODULES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
