"""Public names beside those of the classes: types, constants, functions, and shorter names."""

from armwright_client import public_classes as _all
from armwright_client.client import DEFAULT_URL as DEFAULT_URL
from armwright_client.errors import BY_CODE as BY_CODE
from armwright_client.robots.mjcf_scene import scene_from_mjcf as scene_from_mjcf
from armwright_wire.base import RowsLike as RowsLike
from armwright_wire.base import VectorLike as VectorLike
from armwright_wire.goals.goal import GoalLike as GoalLike
from armwright_wire.motions.certificate import Stops as Stops
from armwright_wire.plans.plan import PlannerName as PlannerName
from armwright_wire.scenes.check import TouchDepth as TouchDepth
from armwright_wire.scenes.scene import SceneReference as SceneReference
from armwright_wire.scenes.scene import Shape as Shape
from armwright_wire.scenes.tool import TipReference as TipReference
from armwright_wire.scenes.tool import ToolReference as ToolReference

TaskStage = _all.StageUnion
# Shorter names of answers, and of parts of requests.
AllowedPair = _all.AllowedAnswer
BatchProblem = _all.PartialPlan
Calibration = _all.CalibrateAnswer
Certificate = _all.CertificateAnswer
ClearanceReport = _all.ClearanceAnswer
CloseSpan = _all.CloseSpanAnswer
ConfigurationReport = _all.ConfigurationAnswer
ConvertedPose = _all.ConvertPoseAnswer
CornerArcReport = _all.CornerArcAnswer
Correction = _all.CorrectionAnswer
DerivedDh = _all.DhAnswer
Descent = _all.DescentAnswer
DhParameters = _all.DhRowAnswer
Excitation = _all.ExcitationAnswer
Export = _all.ExportAnswer
Fitted = _all.FitAnswer
FoundParameter = _all.FoundParameterAnswer
Gradient = _all.GradientOptions
Identification = _all.IdentifyAnswer
GuardVerdict = _all.GuardAnswer
Improvement = _all.ImprovementAnswer
JointPath = _all.PathAnswer
JointState = _all.JointStateBody
Lasalle = _all.LasalleAnswer
Leg = _all.LegAnswer
LimitValues = _all.LimitsBody
Lyapunov = _all.LyapunovAnswer
PathDeviation = _all.PathDeviationAnswer
PathNearness = _all.PathNearnessAnswer
Plan = _all.PlanAnswer
PoseMotion = _all.Motion
Progress = _all.ProgressAnswer
Proved = _all.ProvedAnswer
QuadraticForm = _all.FormAnswer
ReferencePose = _all.ReferencePoseAnswer
Retimed = _all.RetimeAnswer
Simplified = _all.SimplifyAnswer
Robot = _all.RobotAnswer
RoundedCornerReport = _all.RoundedCornerAnswer
SimulatedController = _all.ControllerAnswer
Simulation = _all.SimulateAnswer
SimulationReference = _all.ReferenceAnswer
SingularForm = _all.SingularFormAnswer
SpeedLimit = _all.SpeedLimitAnswer
Stop = _all.StopAnswer
StopsReport = _all.StopsAnswer
TaskPlan = _all.TaskAnswer
TaskStageReport = _all.TaskStageAnswer
TaskStageRequest = _all.StageBody
TaskWorld = _all.WorldAnswer
TimedTrajectory = _all.TrajectoryAnswer
TimingReport = _all.TimingAnswer
ToolMotionReport = _all.ToolMotionAnswer
ToolSpeed = _all.ToolSpeedAnswer
ToolSpeedBand = _all.ToolSpeedBandAnswer
ToolToleranceUse = _all.ToolToleranceAnswer
Tour = _all.TourAnswer
TourImprovement = _all.TourImprovementAnswer
TourSearch = _all.TourSearchAnswer
TrackedLimitUse = _all.LimitUseAnswer
Trajectory = _all.TrajectoryBody
Trial = _all.TrialAnswer
Tube = _all.TubeAnswer
Unvisited = _all.UnvisitedAnswer
Visit = _all.VisitAnswer
WorstStop = _all.WorstStopAnswer
