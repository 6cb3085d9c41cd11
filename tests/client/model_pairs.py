"""Models of the client beside those of the service that they must follow."""

from pydantic import BaseModel

import armwright_client as ours
from armwright_client.base import Readable
from armwright_client.robot import ArchiveFields, RobotFields
from armwright_wire import certificate as their_certificate
from armwright_wire import check as their_attached
from armwright_wire import check as their_check
from armwright_wire import constraint as their_constraint
from armwright_wire import dynamics as their_dynamics
from armwright_wire import export as their_export
from armwright_wire import goal as their_goal
from armwright_wire import goal as their_goal_costs
from armwright_wire import kept_plan as their_kept_plan
from armwright_wire import kinematics as their_kinematics
from armwright_wire import lyapunov as their_lyapunov
from armwright_wire import plan as their_plan
from armwright_wire import pose as their_conversion
from armwright_wire import pose as their_pose
from armwright_wire import potential as their_potential
from armwright_wire import reach as their_reach
from armwright_wire import retime as their_retime
from armwright_wire import robot as their_dh
from armwright_wire import robot as their_motor
from armwright_wire import robot as their_robot
from armwright_wire import scene as their_scene
from armwright_wire import scene as their_shape
from armwright_wire import task as their_sequence
from armwright_wire import task as their_sequence_answer
from armwright_wire import timing as their_timing
from armwright_wire import tool_motion as their_cartesian
from armwright_wire import tool_motion as their_seam
from armwright_wire import tour as their_tour
from armwright_wire import trajectory as their_trajectory

REACH = [
    "ReachTolerance",
    "ReachBox",
    "BaseRegion",
    "ReachRequest",
    "ReachGrid",
    "BaseAnswer",
    "ReachAnswer",
]
TASKS = (
    "ApproachStage",
    "AttachStage",
    "CloseStage",
    "DetachStage",
    "GraspRegion",
    "GraspStage",
    "LiftStage",
    "MoveStage",
    "MovedObject",
    "OpenStage",
    "PlaceRegion",
    "PlaceStage",
    "RetreatStage",
    "TaskRequest",
    "WaitStage",
)
KEPT_PLANS = [
    "DocumentName",
    "KeptPlanSummary",
    "KeptPlan",
    "PlanList",
    "ReplayRequest",
    "ReplayAnswer",
    "Bundle",
]
POTENTIAL = ["PotentialOptions", "PotentialRequest", "ControlPoint", "PotentialAnswer"]
PAIRS: list[tuple[type[Readable], type[BaseModel]]] = [
    (ours.Pose, their_pose.Pose),
    (ours.FramedPose, their_pose.FramedPose),
    (ours.PoseForm, their_conversion.PoseForm),
    (ours.PoseMotion, their_conversion.Motion),
    (ours.ConvertPoseRequest, their_conversion.ConvertPoseRequest),
    (ours.PoseForms, their_conversion.PoseForms),
    (ours.SingularForm, their_conversion.SingularFormAnswer),
    (ours.ConvertedPose, their_conversion.ConvertPoseAnswer),
    (ours.LyapunovRequest, their_lyapunov.LyapunovRequest),
    (ours.QuadraticForm, their_lyapunov.FormAnswer),
    (ours.Pole, their_lyapunov.Pole),
    (ours.Lyapunov, their_lyapunov.LyapunovAnswer),
    (ours.Box, their_shape.Box),
    (ours.Sphere, their_shape.Sphere),
    (ours.Cylinder, their_shape.Cylinder),
    (ours.Capsule, their_shape.Capsule),
    (ours.Cone, their_shape.Cone),
    (ours.Halfspace, their_shape.Halfspace),
    (ours.Convex, their_shape.Convex),
    (ours.Mesh, their_shape.Mesh),
    (ours.PointCloud, their_shape.PointCloud),
    (ours.Motor, their_motor.Motor),
    (ours.Obstacle, their_scene.Obstacle),
    (ours.Scene, their_scene.Scene),
    (ours.SceneSummary, their_scene.SceneSummary),
    (ours.SceneList, their_scene.SceneList),
    (ours.ProjectRequest, their_scene.ProjectRequest),
    (ours.Projection, their_scene.Projection),
    (ours.ProjectAnswer, their_scene.ProjectAnswer),
    (ours.DhRow, their_dh.DhRow),
    (ours.DhTable, their_dh.DhTable),
    (ours.JointLimits, their_robot.JointLimits),
    (RobotFields, their_robot.RobotFields),
    (ArchiveFields, their_robot.ArchiveFields),
    (ours.RobotChanges, their_robot.RobotChanges),
    (ours.DefaultLimits, their_robot.DefaultLimits),
    (ours.RobotUpload, their_robot.RobotBody),
    (ours.Limits, their_robot.Limits),
    (ours.DhParameters, their_dh.DhRowAnswer),
    (ours.DerivedDh, their_dh.DhAnswer),
    (ours.RobotSummary, their_robot.RobotSummary),
    (ours.RobotList, their_robot.RobotList),
    (ours.Robot, their_robot.RobotAnswer),
    (ours.FkRequest, their_kinematics.FkRequest),
    (ours.FkAnswer, their_kinematics.FkAnswer),
    (ours.FkBatch, their_kinematics.FkAnswer),
    (ours.JacobianRequest, their_kinematics.JacobianRequest),
    (ours.JacobianAnswer, their_kinematics.JacobianAnswer),
    (ours.JacobianBatch, their_kinematics.JacobianAnswer),
    (ours.IkRequest, their_kinematics.IkRequest),
    (ours.IkSolution, their_kinematics.IkSolution),
    (ours.IkAnswer, their_kinematics.IkAnswer),
    (ours.IkBatch, their_kinematics.IkAnswer),
    (ours.Unsolved, their_kinematics.Unsolved),
    *(
        (getattr(ours, name), getattr(their_constraint, name))
        for name in (
            "BoxRegion",
            "ClearanceConstraint",
            "ConstraintUse",
            "JointConstraint",
            "LineRegion",
            "LookAtConstraint",
            "OrientationConstraint",
            "PlaneRegion",
            "PositionConstraint",
            "RelativePoseConstraint",
            "SphereRegion",
            "ToolSpeedConstraint",
            "TorqueConstraint",
        )
    ),
    (ours.Attached, their_attached.Attached),
    (ours.CheckRequest, their_check.CheckRequest),
    (ours.Collision, their_check.Collision),
    (ours.LimitViolation, their_check.LimitViolation),
    (ours.CheckAnswer, their_check.CheckAnswer),
    (ours.CheckBatch, their_check.CheckAnswer),
    (ours.Start, their_goal.Start),
    (ours.SingleGoal, their_goal.SingleGoal),
    (ours.Goal, their_goal.Goal),
    (ours.Timing, their_timing.Timing),
    (ours.PlanRequest, their_plan.PlanRequest),
    (ours.Segment, their_trajectory.Segment),
    (ours.Samples, their_trajectory.Samples),
    (ours.Trajectory, their_trajectory.TrajectoryBody),
    (ours.LimitValues, their_trajectory.LimitsBody),
    (ours.TimedTrajectory, their_trajectory.TrajectoryAnswer),
    (ours.ValidateRequest, their_plan.ValidateRequest),
    (ours.Stage, their_plan.Stage),
    (ours.JointPath, their_plan.PathAnswer),
    (ours.LimitUse, their_certificate.LimitUse),
    (ours.LimitUses, their_certificate.LimitUses),
    (ours.Certificate, their_certificate.CertificateAnswer),
    (ours.Proved, their_certificate.ProvedAnswer),
    (ours.TimedToolMotions, their_cartesian.TimedToolMotions),
    (ours.PathDeviation, their_cartesian.PathDeviationAnswer),
    (ours.ToolMotion, their_cartesian.ToolMotion),
    (ours.CartesianOptions, their_cartesian.CartesianOptions),
    (ours.ToolTolerance, their_seam.ToolTolerance),
    (ours.Waypoint, their_seam.Waypoint),
    (ours.StraightOffset, their_seam.StraightOffset),
    (ours.ToolSpeed, their_seam.ToolSpeedAnswer),
    (ours.ToolToleranceUse, their_seam.ToolToleranceAnswer),
    (ours.ToolMotionReport, their_cartesian.ToolMotionAnswer),
    (ours.ReferencePose, their_cartesian.ReferencePoseAnswer),
    (ours.Reproducibility, their_plan.Reproducibility),
    (ours.Plan, their_plan.PlanAnswer),
    (ours.Descent, their_plan.DescentAnswer),
    (ours.Progress, their_plan.ProgressAnswer),
    (ours.ForwardDynamicsRequest, their_dynamics.ForwardDynamicsRequest),
    (ours.ForwardDynamicsAnswer, their_dynamics.ForwardDynamicsAnswer),
    (ours.ForwardDynamicsBatch, their_dynamics.ForwardDynamicsAnswer),
    (ours.PartialJacobian, their_dynamics.PartialJacobian),
    *((getattr(ours, name), getattr(their_potential, name)) for name in POTENTIAL),
    (ours.PotentialBatch, their_potential.PotentialAnswer),
    *((getattr(ours, name), getattr(their_reach, name)) for name in REACH),
    *((getattr(ours, name), getattr(their_kept_plan, name)) for name in KEPT_PLANS),
    *((getattr(ours, name), getattr(their_sequence, name)) for name in TASKS),
    (ours.PlacedObject, their_sequence_answer.PlacedObject),
    (ours.HeldObject, their_sequence_answer.HeldObject),
    (ours.TaskWorld, their_sequence_answer.WorldAnswer),
    (ours.TaskStageReport, their_sequence_answer.TaskStageAnswer),
    (ours.ConfigurationReport, their_goal_costs.ConfigurationAnswer),
    (ours.Trial, their_sequence_answer.TrialAnswer),
    (ours.Improvement, their_sequence_answer.ImprovementAnswer),
    (ours.TaskPlan, their_sequence_answer.TaskAnswer),
    (ours.TourGoal, their_tour.TourGoal),
    (ours.TourRequest, their_tour.TourRequest),
    (ours.Visit, their_tour.VisitAnswer),
    (ours.Leg, their_tour.LegAnswer),
    (ours.Unvisited, their_tour.UnvisitedAnswer),
    (ours.TourImprovement, their_tour.TourImprovementAnswer),
    (ours.TourSearch, their_tour.TourSearchAnswer),
    (ours.Tour, their_tour.TourAnswer),
    (ours.ExportRequest, their_export.ExportRequest),
    (ours.Export, their_export.ExportAnswer),
    (ours.JointState, their_retime.JointStateBody),
    (ours.RetimePath, their_retime.RetimePath),
    (ours.RetimeTiming, their_retime.RetimeTiming),
    (ours.RetimeRequest, their_retime.RetimeRequest),
    (ours.Retimed, their_retime.RetimeAnswer),
]
