"""Public classes: all those of `armwright_wire`'s requests and answers, and those of the client.

Modules are imported whole, but for those of the client with more inside, and for those with an
answer that `armwright_client.answers` gives a narrower type.
"""

from armwright_client.answers import *
from armwright_client.call import AsyncPending as AsyncPending
from armwright_client.call import Pending as Pending
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
from armwright_client.errors import *
from armwright_client.guard import Guard as Guard
from armwright_client.guard import GuardedActions as GuardedActions
from armwright_client.job import Job as Job
from armwright_client.job import JobEvent as JobEvent
from armwright_client.job import JobList as JobList
from armwright_client.options.arm_options import *
from armwright_client.options.plan_options import *
from armwright_client.robots.robot import ArchiveOptions as ArchiveOptions
from armwright_client.robots.robot import RobotArchive as RobotArchive
from armwright_client.robots.robot import RobotOptions as RobotOptions
from armwright_client.robots.robot import RobotUpload as RobotUpload
from armwright_client.session import ClientOptions as ClientOptions
from armwright_client.session import Retry as Retry
from armwright_wire.base import ArrayLike as ArrayLike
from armwright_wire.errors import *
from armwright_wire.goals.goal import *
from armwright_wire.goals.tool_motion import *
from armwright_wire.motions.certificate import *
from armwright_wire.motions.excitation import *
from armwright_wire.motions.export import *
from armwright_wire.motions.retime import *
from armwright_wire.motions.simulation import *
from armwright_wire.motions.timing import *
from armwright_wire.motions.trajectory import *
from armwright_wire.plans.batch import *
from armwright_wire.plans.guard import *
from armwright_wire.plans.job import Problem as Problem
from armwright_wire.plans.kept_plan import *
from armwright_wire.plans.plan import *
from armwright_wire.plans.stages import *
from armwright_wire.plans.task import *
from armwright_wire.plans.tour import *
from armwright_wire.pose import *
from armwright_wire.robots.calibration import *
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
from armwright_wire.robots.identification import *
from armwright_wire.robots.kinematics import ArmSides as ArmSides
from armwright_wire.robots.kinematics import DampedDirection as DampedDirection
from armwright_wire.robots.kinematics import FkRequest as FkRequest
from armwright_wire.robots.kinematics import GradientOptions as GradientOptions
from armwright_wire.robots.kinematics import GradientTrace as GradientTrace
from armwright_wire.robots.kinematics import IkRequest as IkRequest
from armwright_wire.robots.kinematics import IkSolution as IkSolution
from armwright_wire.robots.kinematics import JacobianRequest as JacobianRequest
from armwright_wire.robots.kinematics import Unsolved as Unsolved
from armwright_wire.robots.kinematics import VelocityRequest as VelocityRequest
from armwright_wire.robots.lyapunov import *
from armwright_wire.robots.payload import *
from armwright_wire.robots.potential import ControlPoint as ControlPoint
from armwright_wire.robots.potential import PotentialOptions as PotentialOptions
from armwright_wire.robots.potential import PotentialRequest as PotentialRequest
from armwright_wire.robots.reach import *
from armwright_wire.robots.robot import *
from armwright_wire.scenes.check import AllowedAnswer as AllowedAnswer
from armwright_wire.scenes.check import Attached as Attached
from armwright_wire.scenes.check import CheckRequest as CheckRequest
from armwright_wire.scenes.check import Collision as Collision
from armwright_wire.scenes.check import LimitViolation as LimitViolation
from armwright_wire.scenes.scene import *
from armwright_wire.scenes.tool import *
