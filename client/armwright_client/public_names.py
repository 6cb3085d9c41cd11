"""Public names of the package, under which its modules and `armwright_wire` are used."""

from armwright_client.answers import CheckAnswer as CheckAnswer
from armwright_client.answers import CheckBatch as CheckBatch
from armwright_client.answers import DynamicsAnswer as DynamicsAnswer
from armwright_client.answers import DynamicsBatch as DynamicsBatch
from armwright_client.answers import FkAnswer as FkAnswer
from armwright_client.answers import FkBatch as FkBatch
from armwright_client.answers import ForwardDynamicsAnswer as ForwardDynamicsAnswer
from armwright_client.answers import ForwardDynamicsBatch as ForwardDynamicsBatch
from armwright_client.answers import Health as Health
from armwright_client.answers import IkAnswer as IkAnswer
from armwright_client.answers import IkBatch as IkBatch
from armwright_client.answers import JacobianAnswer as JacobianAnswer
from armwright_client.answers import JacobianBatch as JacobianBatch
from armwright_client.answers import PotentialAnswer as PotentialAnswer
from armwright_client.answers import PotentialBatch as PotentialBatch
from armwright_client.answers import Readiness as Readiness
from armwright_client.answers import RegressorAnswer as RegressorAnswer
from armwright_client.answers import VelocityAnswer as VelocityAnswer
from armwright_client.answers import WrenchAnswer as WrenchAnswer
from armwright_client.answers import WrenchBatch as WrenchBatch
from armwright_client.call import AsyncPending as AsyncPending
from armwright_client.call import Pending as Pending
from armwright_client.client import DEFAULT_URL as DEFAULT_URL
from armwright_client.client import AsyncClient as AsyncClient
from armwright_client.client import AsyncJobs as AsyncJobs
from armwright_client.client import AsyncLater as AsyncLater
from armwright_client.client import AsyncPlans as AsyncPlans
from armwright_client.client import AsyncRobots as AsyncRobots
from armwright_client.client import AsyncScenes as AsyncScenes
from armwright_client.client import AsyncTools as AsyncTools
from armwright_client.client import Client as Client
from armwright_client.client import Jobs as Jobs
from armwright_client.client import Later as Later
from armwright_client.client import Plans as Plans
from armwright_client.client import Robots as Robots
from armwright_client.client import Scenes as Scenes
from armwright_client.client import Tools as Tools
from armwright_client.errors import BY_CODE as BY_CODE
from armwright_client.errors import ApiError as ApiError
from armwright_client.errors import CertificateDisputed as CertificateDisputed
from armwright_client.errors import Conflict as Conflict
from armwright_client.errors import Forbidden as Forbidden
from armwright_client.errors import GoalInCollision as GoalInCollision
from armwright_client.errors import GoalStateInvalid as GoalStateInvalid
from armwright_client.errors import GoalViolatesPathConstraints as GoalViolatesPathConstraints
from armwright_client.errors import HostNotAllowed as HostNotAllowed
from armwright_client.errors import IdempotencyKeyReused as IdempotencyKeyReused
from armwright_client.errors import InCollision as InCollision
from armwright_client.errors import InvalidGoalConstraints as InvalidGoalConstraints
from armwright_client.errors import InvalidGroupName as InvalidGroupName
from armwright_client.errors import InvalidLinkName as InvalidLinkName
from armwright_client.errors import InvalidMotionPlan as InvalidMotionPlan
from armwright_client.errors import InvalidObjectName as InvalidObjectName
from armwright_client.errors import InvalidRequest as InvalidRequest
from armwright_client.errors import InvalidRobotDescription as InvalidRobotDescription
from armwright_client.errors import InvalidRobotState as InvalidRobotState
from armwright_client.errors import InvalidScene as InvalidScene
from armwright_client.errors import MethodNotAllowed as MethodNotAllowed
from armwright_client.errors import MissingInertia as MissingInertia
from armwright_client.errors import MissingLimit as MissingLimit
from armwright_client.errors import NoIkSolution as NoIkSolution
from armwright_client.errors import NotFound as NotFound
from armwright_client.errors import NotReady as NotReady
from armwright_client.errors import NoWay as NoWay
from armwright_client.errors import OutOfMemory as OutOfMemory
from armwright_client.errors import OutsideLimits as OutsideLimits
from armwright_client.errors import Overloaded as Overloaded
from armwright_client.errors import PayloadTooLarge as PayloadTooLarge
from armwright_client.errors import PlanningFailed as PlanningFailed
from armwright_client.errors import PreconditionFailed as PreconditionFailed
from armwright_client.errors import Preempted as Preempted
from armwright_client.errors import QuotaExceeded as QuotaExceeded
from armwright_client.errors import RequestTimeout as RequestTimeout
from armwright_client.errors import StartStateInCollision as StartStateInCollision
from armwright_client.errors import StartStateInvalid as StartStateInvalid
from armwright_client.errors import (
    StartStateViolatesPathConstraints as StartStateViolatesPathConstraints,
)
from armwright_client.errors import StorageUnavailable as StorageUnavailable
from armwright_client.errors import TimedOut as TimedOut
from armwright_client.errors import TransportError as TransportError
from armwright_client.errors import TransportTimeout as TransportTimeout
from armwright_client.errors import Unauthenticated as Unauthenticated
from armwright_client.errors import Unavailable as Unavailable
from armwright_client.errors import UnexpectedAnswer as UnexpectedAnswer
from armwright_client.errors import UnrecognizedGoalType as UnrecognizedGoalType
from armwright_client.errors import UnsupportedMediaType as UnsupportedMediaType
from armwright_client.errors import ValidationFailed as ValidationFailed
from armwright_client.errors import WorkerCrashed as WorkerCrashed
from armwright_client.guard import Guard as Guard
from armwright_client.guard import GuardedActions as GuardedActions
from armwright_client.job import Job as Job
from armwright_client.job import JobEvent as JobEvent
from armwright_client.job import JobList as JobList
from armwright_client.options.arm_options import DynamicsOptions as DynamicsOptions
from armwright_client.options.arm_options import FkOptions as FkOptions
from armwright_client.options.arm_options import ForwardDynamicsOptions as ForwardDynamicsOptions
from armwright_client.options.arm_options import IkOptions as IkOptions
from armwright_client.options.arm_options import JacobianOptions as JacobianOptions
from armwright_client.options.arm_options import ModelOptions as ModelOptions
from armwright_client.options.arm_options import PotentialSettings as PotentialSettings
from armwright_client.options.arm_options import ReachOptions as ReachOptions
from armwright_client.options.arm_options import RegressorOptions as RegressorOptions
from armwright_client.options.arm_options import VelocityOptions as VelocityOptions
from armwright_client.options.arm_options import WrenchOptions as WrenchOptions
from armwright_client.options.plan_options import CheckOptions as CheckOptions
from armwright_client.options.plan_options import ExportOptions as ExportOptions
from armwright_client.options.plan_options import GuardOptions as GuardOptions
from armwright_client.options.plan_options import LyapunovOptions as LyapunovOptions
from armwright_client.options.plan_options import PlanOptions as PlanOptions
from armwright_client.options.plan_options import ProgramOptions as ProgramOptions
from armwright_client.options.plan_options import RetimeOptions as RetimeOptions
from armwright_client.options.plan_options import SimulateOptions as SimulateOptions
from armwright_client.options.plan_options import TaskOptions as TaskOptions
from armwright_client.options.plan_options import TourOptions as TourOptions
from armwright_client.options.plan_options import ValidateOptions as ValidateOptions
from armwright_client.robots.mjcf_scene import scene_from_mjcf as scene_from_mjcf
from armwright_client.robots.robot import ArchiveOptions as ArchiveOptions
from armwright_client.robots.robot import RobotArchive as RobotArchive
from armwright_client.robots.robot import RobotOptions as RobotOptions
from armwright_client.robots.robot import RobotUpload as RobotUpload
from armwright_client.session import ClientOptions as ClientOptions
from armwright_client.session import Retry as Retry
from armwright_wire import pose as _pose
from armwright_wire.base import ArrayLike as ArrayLike
from armwright_wire.base import RowsLike as RowsLike
from armwright_wire.base import VectorLike as VectorLike
from armwright_wire.errors import ArmwrightError as ArmwrightError
from armwright_wire.errors import InvalidArgument as InvalidArgument
from armwright_wire.goals import goal as _goal
from armwright_wire.goals import tool_motion as _tool_motion
from armwright_wire.goals.goal import BoxRegion as BoxRegion
from armwright_wire.goals.goal import Clearance as Clearance
from armwright_wire.goals.goal import ClearanceConstraint as ClearanceConstraint
from armwright_wire.goals.goal import ConstraintUse as ConstraintUse
from armwright_wire.goals.goal import Goal as Goal
from armwright_wire.goals.goal import GoalCosts as GoalCosts
from armwright_wire.goals.goal import GoalLike as GoalLike
from armwright_wire.goals.goal import JointConstraint as JointConstraint
from armwright_wire.goals.goal import LineRegion as LineRegion
from armwright_wire.goals.goal import LookAtConstraint as LookAtConstraint
from armwright_wire.goals.goal import OrientationConstraint as OrientationConstraint
from armwright_wire.goals.goal import PlaneRegion as PlaneRegion
from armwright_wire.goals.goal import PositionConstraint as PositionConstraint
from armwright_wire.goals.goal import RelativePoseConstraint as RelativePoseConstraint
from armwright_wire.goals.goal import SingleGoal as SingleGoal
from armwright_wire.goals.goal import SphereRegion as SphereRegion
from armwright_wire.goals.goal import Start as Start
from armwright_wire.goals.goal import ToolSpeedConstraint as ToolSpeedConstraint
from armwright_wire.goals.goal import TorqueConstraint as TorqueConstraint
from armwright_wire.goals.tool_motion import CartesianOptions as CartesianOptions
from armwright_wire.goals.tool_motion import CornerArc as CornerArc
from armwright_wire.goals.tool_motion import RoundedCorner as RoundedCorner
from armwright_wire.goals.tool_motion import StraightOffset as StraightOffset
from armwright_wire.goals.tool_motion import TimedToolMotion as TimedToolMotion
from armwright_wire.goals.tool_motion import TimedToolMotions as TimedToolMotions
from armwright_wire.goals.tool_motion import ToolMotion as ToolMotion
from armwright_wire.goals.tool_motion import ToolTolerance as ToolTolerance
from armwright_wire.goals.tool_motion import Waypoint as Waypoint
from armwright_wire.motions import certificate as _certificate
from armwright_wire.motions import excitation as _excitation
from armwright_wire.motions import export as _export
from armwright_wire.motions import retime as _retime
from armwright_wire.motions import simulation as _simulation
from armwright_wire.motions import timing as _timing
from armwright_wire.motions import trajectory as _trajectory
from armwright_wire.motions.certificate import LimitUse as LimitUse
from armwright_wire.motions.certificate import LimitUses as LimitUses
from armwright_wire.motions.certificate import Premises as Premises
from armwright_wire.motions.certificate import Stops as Stops
from armwright_wire.motions.excitation import ExcitationRequest as ExcitationRequest
from armwright_wire.motions.export import ExportRequest as ExportRequest
from armwright_wire.motions.export import KeptMotion as KeptMotion
from armwright_wire.motions.retime import FitRequest as FitRequest
from armwright_wire.motions.retime import LimitsAt as LimitsAt
from armwright_wire.motions.retime import PathBody as PathBody
from armwright_wire.motions.retime import PathToKeep as PathToKeep
from armwright_wire.motions.retime import PathTolerance as PathTolerance
from armwright_wire.motions.retime import RetimePath as RetimePath
from armwright_wire.motions.retime import RetimeRequest as RetimeRequest
from armwright_wire.motions.retime import RetimeTiming as RetimeTiming
from armwright_wire.motions.retime import SimplifyRequest as SimplifyRequest
from armwright_wire.motions.retime import TipTolerance as TipTolerance
from armwright_wire.motions.simulation import RemainingClearance as RemainingClearance
from armwright_wire.motions.simulation import SimulateRequest as SimulateRequest
from armwright_wire.motions.timing import RuledLimits as RuledLimits
from armwright_wire.motions.timing import Timing as Timing
from armwright_wire.motions.trajectory import Samples as Samples
from armwright_wire.motions.trajectory import Segment as Segment
from armwright_wire.plans import batch as _batch
from armwright_wire.plans import guard as _guard
from armwright_wire.plans import kept_plan as _kept_plan
from armwright_wire.plans import plan as _plan
from armwright_wire.plans import stages as _stages
from armwright_wire.plans import task as _task
from armwright_wire.plans import tour as _tour
from armwright_wire.plans.batch import BatchAnswer as BatchAnswer
from armwright_wire.plans.batch import BatchRequest as BatchRequest
from armwright_wire.plans.guard import GuardChange as GuardChange
from armwright_wire.plans.guard import GuardOpening as GuardOpening
from armwright_wire.plans.guard import GuardReady as GuardReady
from armwright_wire.plans.guard import GuardRequest as GuardRequest
from armwright_wire.plans.guard import GuardState as GuardState
from armwright_wire.plans.guard import GuardStep as GuardStep
from armwright_wire.plans.guard import GuardStop as GuardStop
from armwright_wire.plans.guard import GuardViolation as GuardViolation
from armwright_wire.plans.guard import Proposal as Proposal
from armwright_wire.plans.guard import SceneChange as SceneChange
from armwright_wire.plans.job import Problem as Problem
from armwright_wire.plans.kept_plan import Bundle as Bundle
from armwright_wire.plans.kept_plan import DocumentName as DocumentName
from armwright_wire.plans.kept_plan import KeptPlan as KeptPlan
from armwright_wire.plans.kept_plan import KeptPlanSummary as KeptPlanSummary
from armwright_wire.plans.kept_plan import PlanList as PlanList
from armwright_wire.plans.kept_plan import ReplayAnswer as ReplayAnswer
from armwright_wire.plans.kept_plan import ReplayRequest as ReplayRequest
from armwright_wire.plans.kept_plan import StopRequest as StopRequest
from armwright_wire.plans.plan import PlannerName as PlannerName
from armwright_wire.plans.plan import PlanRequest as PlanRequest
from armwright_wire.plans.plan import Refine as Refine
from armwright_wire.plans.plan import Reproducibility as Reproducibility
from armwright_wire.plans.plan import Stage as Stage
from armwright_wire.plans.plan import ValidateRequest as ValidateRequest
from armwright_wire.plans.stages import ApproachStage as ApproachStage
from armwright_wire.plans.stages import ArcStage as ArcStage
from armwright_wire.plans.stages import AttachStage as AttachStage
from armwright_wire.plans.stages import CloseStage as CloseStage
from armwright_wire.plans.stages import DetachStage as DetachStage
from armwright_wire.plans.stages import FallbackStage as FallbackStage
from armwright_wire.plans.stages import FollowStage as FollowStage
from armwright_wire.plans.stages import ForEachStage as ForEachStage
from armwright_wire.plans.stages import FoundGrasps as FoundGrasps
from armwright_wire.plans.stages import GraspRegion as GraspRegion
from armwright_wire.plans.stages import GraspSearch as GraspSearch
from armwright_wire.plans.stages import GraspStage as GraspStage
from armwright_wire.plans.stages import InsertStage as InsertStage
from armwright_wire.plans.stages import LiftStage as LiftStage
from armwright_wire.plans.stages import LineStage as LineStage
from armwright_wire.plans.stages import MoveStage as MoveStage
from armwright_wire.plans.stages import OpenStage as OpenStage
from armwright_wire.plans.stages import PlaceGrid as PlaceGrid
from armwright_wire.plans.stages import PlaceRegion as PlaceRegion
from armwright_wire.plans.stages import PlaceStage as PlaceStage
from armwright_wire.plans.stages import RegraspStage as RegraspStage
from armwright_wire.plans.stages import RestingPlaces as RestingPlaces
from armwright_wire.plans.stages import RetreatStage as RetreatStage
from armwright_wire.plans.stages import SeamStage as SeamStage
from armwright_wire.plans.stages import SetStage as SetStage
from armwright_wire.plans.stages import SignalStage as SignalStage
from armwright_wire.plans.stages import StraightStage as StraightStage
from armwright_wire.plans.stages import Via as Via
from armwright_wire.plans.stages import WaitForStage as WaitForStage
from armwright_wire.plans.stages import WaitStage as WaitStage
from armwright_wire.plans.task import EventAnswer as EventAnswer
from armwright_wire.plans.task import HeldObject as HeldObject
from armwright_wire.plans.task import MovedObject as MovedObject
from armwright_wire.plans.task import PlacedObject as PlacedObject
from armwright_wire.plans.task import TaskRequest as TaskRequest
from armwright_wire.plans.tour import TourGoal as TourGoal
from armwright_wire.plans.tour import TourRequest as TourRequest
from armwright_wire.pose import ConvertPoseRequest as ConvertPoseRequest
from armwright_wire.pose import FramedPose as FramedPose
from armwright_wire.pose import Pose as Pose
from armwright_wire.pose import PoseForm as PoseForm
from armwright_wire.pose import PoseForms as PoseForms
from armwright_wire.robots import calibration as _calibration
from armwright_wire.robots import identification as _identification
from armwright_wire.robots import kinematics as _kinematics
from armwright_wire.robots import lyapunov as _lyapunov
from armwright_wire.robots import robot as _robot
from armwright_wire.robots.calibration import Accuracy as Accuracy
from armwright_wire.robots.calibration import CalibrateRequest as CalibrateRequest
from armwright_wire.robots.calibration import LinkMargin as LinkMargin
from armwright_wire.robots.calibration import Plane as Plane
from armwright_wire.robots.dynamics import Abbreviation as Abbreviation
from armwright_wire.robots.dynamics import BaseParameter as BaseParameter
from armwright_wire.robots.dynamics import ChristoffelFormula as ChristoffelFormula
from armwright_wire.robots.dynamics import DynamicsRequest as DynamicsRequest
from armwright_wire.robots.dynamics import EquationsAnswer as EquationsAnswer
from armwright_wire.robots.dynamics import ForwardDynamicsRequest as ForwardDynamicsRequest
from armwright_wire.robots.dynamics import JointSymbol as JointSymbol
from armwright_wire.robots.dynamics import MotionFormulas as MotionFormulas
from armwright_wire.robots.dynamics import ParameterSymbol as ParameterSymbol
from armwright_wire.robots.dynamics import PartialJacobian as PartialJacobian
from armwright_wire.robots.dynamics import PoseFormulas as PoseFormulas
from armwright_wire.robots.dynamics import RegressorFormulas as RegressorFormulas
from armwright_wire.robots.dynamics import RegressorRequest as RegressorRequest
from armwright_wire.robots.dynamics import WrenchRequest as WrenchRequest
from armwright_wire.robots.identification import IdentifyRequest as IdentifyRequest
from armwright_wire.robots.identification import JointResidual as JointResidual
from armwright_wire.robots.identification import LogBody as LogBody
from armwright_wire.robots.kinematics import ArmSides as ArmSides
from armwright_wire.robots.kinematics import DampedDirection as DampedDirection
from armwright_wire.robots.kinematics import FkRequest as FkRequest
from armwright_wire.robots.kinematics import GradientTrace as GradientTrace
from armwright_wire.robots.kinematics import IkRequest as IkRequest
from armwright_wire.robots.kinematics import IkSolution as IkSolution
from armwright_wire.robots.kinematics import JacobianRequest as JacobianRequest
from armwright_wire.robots.kinematics import Unsolved as Unsolved
from armwright_wire.robots.kinematics import VelocityRequest as VelocityRequest
from armwright_wire.robots.lyapunov import LyapunovRequest as LyapunovRequest
from armwright_wire.robots.lyapunov import PendulumParameters as PendulumParameters
from armwright_wire.robots.lyapunov import Pole as Pole
from armwright_wire.robots.payload import Payload as Payload
from armwright_wire.robots.potential import ControlPoint as ControlPoint
from armwright_wire.robots.potential import PotentialOptions as PotentialOptions
from armwright_wire.robots.potential import PotentialRequest as PotentialRequest
from armwright_wire.robots.reach import BaseAnswer as BaseAnswer
from armwright_wire.robots.reach import BaseRegion as BaseRegion
from armwright_wire.robots.reach import ReachAnswer as ReachAnswer
from armwright_wire.robots.reach import ReachBox as ReachBox
from armwright_wire.robots.reach import ReachGrid as ReachGrid
from armwright_wire.robots.reach import ReachRequest as ReachRequest
from armwright_wire.robots.reach import ReachTolerance as ReachTolerance
from armwright_wire.robots.robot import BodySurface as BodySurface
from armwright_wire.robots.robot import DefaultLimits as DefaultLimits
from armwright_wire.robots.robot import DhRow as DhRow
from armwright_wire.robots.robot import DhTable as DhTable
from armwright_wire.robots.robot import FingerJoint as FingerJoint
from armwright_wire.robots.robot import GeometryAnswer as GeometryAnswer
from armwright_wire.robots.robot import JointLimits as JointLimits
from armwright_wire.robots.robot import Limits as Limits
from armwright_wire.robots.robot import LinkCapsules as LinkCapsules
from armwright_wire.robots.robot import LinkInertia as LinkInertia
from armwright_wire.robots.robot import LinkSolid as LinkSolid
from armwright_wire.robots.robot import Motor as Motor
from armwright_wire.robots.robot import RobotCalibration as RobotCalibration
from armwright_wire.robots.robot import RobotChanges as RobotChanges
from armwright_wire.robots.robot import RobotInertias as RobotInertias
from armwright_wire.robots.robot import RobotList as RobotList
from armwright_wire.robots.robot import RobotSummary as RobotSummary
from armwright_wire.robots.robot import SuspectedPair as SuspectedPair
from armwright_wire.scenes import check as _check
from armwright_wire.scenes.check import Attached as Attached
from armwright_wire.scenes.check import CheckRequest as CheckRequest
from armwright_wire.scenes.check import Collision as Collision
from armwright_wire.scenes.check import LimitViolation as LimitViolation
from armwright_wire.scenes.check import TouchDepth as TouchDepth
from armwright_wire.scenes.scene import Box as Box
from armwright_wire.scenes.scene import Capsule as Capsule
from armwright_wire.scenes.scene import Cone as Cone
from armwright_wire.scenes.scene import Convex as Convex
from armwright_wire.scenes.scene import Cylinder as Cylinder
from armwright_wire.scenes.scene import Halfspace as Halfspace
from armwright_wire.scenes.scene import LimitedPair as LimitedPair
from armwright_wire.scenes.scene import Mesh as Mesh
from armwright_wire.scenes.scene import Obstacle as Obstacle
from armwright_wire.scenes.scene import PointCloud as PointCloud
from armwright_wire.scenes.scene import ProjectAnswer as ProjectAnswer
from armwright_wire.scenes.scene import Projection as Projection
from armwright_wire.scenes.scene import ProjectRequest as ProjectRequest
from armwright_wire.scenes.scene import Scene as Scene
from armwright_wire.scenes.scene import SceneList as SceneList
from armwright_wire.scenes.scene import SceneReference as SceneReference
from armwright_wire.scenes.scene import SceneSummary as SceneSummary
from armwright_wire.scenes.scene import Shape as Shape
from armwright_wire.scenes.scene import Sphere as Sphere
from armwright_wire.scenes.tool import HeldTip as HeldTip
from armwright_wire.scenes.tool import Margins as Margins
from armwright_wire.scenes.tool import NamedTool as NamedTool
from armwright_wire.scenes.tool import ParallelJaw as ParallelJaw
from armwright_wire.scenes.tool import Solid as Solid
from armwright_wire.scenes.tool import Spindle as Spindle
from armwright_wire.scenes.tool import SuctionCup as SuctionCup
from armwright_wire.scenes.tool import ThreeJaw as ThreeJaw
from armwright_wire.scenes.tool import TipReference as TipReference
from armwright_wire.scenes.tool import Tool as Tool
from armwright_wire.scenes.tool import ToolFinger as ToolFinger
from armwright_wire.scenes.tool import ToolList as ToolList
from armwright_wire.scenes.tool import ToolReference as ToolReference
from armwright_wire.scenes.tool import ToolSummary as ToolSummary
from armwright_wire.scenes.tool import Torch as Torch

# Shorter names of answers, and of parts of requests.
AllowedPair = _check.AllowedAnswer
BatchProblem = _batch.PartialPlan
Calibration = _calibration.CalibrateAnswer
Certificate = _certificate.CertificateAnswer
ClearanceReport = _goal.ClearanceAnswer
CloseSpan = _goal.CloseSpanAnswer
ConfigurationReport = _goal.ConfigurationAnswer
ConvertedPose = _pose.ConvertPoseAnswer
CornerArcReport = _tool_motion.CornerArcAnswer
Correction = _calibration.CorrectionAnswer
DerivedDh = _robot.DhAnswer
Descent = _plan.DescentAnswer
DhParameters = _robot.DhRowAnswer
Excitation = _excitation.ExcitationAnswer
Export = _export.ExportAnswer
Fitted = _retime.FitAnswer
FoundParameter = _identification.FoundParameterAnswer
Gradient = _kinematics.GradientOptions
Identification = _identification.IdentifyAnswer
GuardVerdict = _guard.GuardAnswer
Improvement = _task.ImprovementAnswer
JointPath = _plan.PathAnswer
JointState = _retime.JointStateBody
Lasalle = _lyapunov.LasalleAnswer
Leg = _tour.LegAnswer
LimitValues = _trajectory.LimitsBody
Lyapunov = _lyapunov.LyapunovAnswer
PathDeviation = _certificate.PathDeviationAnswer
PathNearness = _certificate.PathNearnessAnswer
Plan = _plan.PlanAnswer
PoseMotion = _pose.Motion
Progress = _plan.ProgressAnswer
Proved = _certificate.ProvedAnswer
QuadraticForm = _lyapunov.FormAnswer
ReferencePose = _tool_motion.ReferencePoseAnswer
Retimed = _retime.RetimeAnswer
Simplified = _retime.SimplifyAnswer
Robot = _robot.RobotAnswer
RoundedCornerReport = _tool_motion.RoundedCornerAnswer
SimulatedController = _simulation.ControllerAnswer
Simulation = _simulation.SimulateAnswer
SimulationReference = _simulation.ReferenceAnswer
SingularForm = _pose.SingularFormAnswer
SpeedLimit = _tool_motion.SpeedLimitAnswer
Stop = _kept_plan.StopAnswer
StopsReport = _certificate.StopsAnswer
TaskPlan = _task.TaskAnswer
TaskStage = _stages.StageUnion
TaskStageReport = _task.TaskStageAnswer
TaskStageRequest = _stages.StageBody
TaskWorld = _task.WorldAnswer
TimedTrajectory = _trajectory.TrajectoryAnswer
TimingReport = _timing.TimingAnswer
ToolMotionReport = _tool_motion.ToolMotionAnswer
ToolSpeed = _certificate.ToolSpeedAnswer
ToolSpeedBand = _certificate.ToolSpeedBandAnswer
ToolToleranceUse = _certificate.ToolToleranceAnswer
Tour = _tour.TourAnswer
TourImprovement = _tour.TourImprovementAnswer
TourSearch = _tour.TourSearchAnswer
TrackedLimitUse = _simulation.LimitUseAnswer
Trajectory = _trajectory.TrajectoryBody
Trial = _task.TrialAnswer
Tube = _simulation.TubeAnswer
Unvisited = _tour.UnvisitedAnswer
Visit = _tour.VisitAnswer
WorstStop = _certificate.WorstStopAnswer
