"""The tasks that the server asks workers to call, without the modules that they are in.

Those import all that computes: half a gigabyte of libraries that the server has no use for. A type
checker sees the tasks themselves; the server has their names, each held by a test.
"""

from typing import TYPE_CHECKING

from service.workers.chunk_sizes import TURN
from service.workers.fork.launch import Recipe
from service.workers.task import GRACE, TaskReference

if TYPE_CHECKING:
    from service.endpoints.batch.task import cut as cut
    from service.endpoints.batch.task import plan_part as plan_part
    from service.endpoints.batch.task import split as split
    from service.endpoints.check.task import check as check
    from service.endpoints.check.task import project as project
    from service.endpoints.dynamics import task as dynamics_tasks
    from service.endpoints.dynamics.equations import equations as equations
    from service.endpoints.export.task import export as export
    from service.endpoints.guard.task import guard as guard
    from service.endpoints.guard.task import guard_message as guard_message
    from service.endpoints.identification.task import calibrate as calibrate
    from service.endpoints.identification.task import excitation as excitation
    from service.endpoints.identification.task import identify as identify
    from service.endpoints.ik.task import ik as ik
    from service.endpoints.kinematics import task as kinematics_tasks
    from service.endpoints.kinematics.task import convert_pose as convert_pose
    from service.endpoints.large_body import outline as outline
    from service.endpoints.lyapunov.task import lyapunov as lyapunov
    from service.endpoints.plan.task import plan as plan
    from service.endpoints.plan.task import validate as validate
    from service.endpoints.plans.audit import audit as audit
    from service.endpoints.plans.program import swept as swept
    from service.endpoints.plans.stop import stop as stop
    from service.endpoints.plans.view import view as view
    from service.endpoints.plans.witness import witness as witness
    from service.endpoints.potential.task import potential as potential
    from service.endpoints.reach.task import reach as reach
    from service.endpoints.retime.task import convert as convert
    from service.endpoints.retime.task import fit as fit
    from service.endpoints.retime.task import retime as retime
    from service.endpoints.retime.task import simplify as simplify
    from service.endpoints.robots.geometry import finger_poses as finger_poses
    from service.endpoints.robots.geometry import robot_geometry as robot_geometry
    from service.endpoints.robots.task import change_robot as change_robot
    from service.endpoints.robots.task import make_robot as make_robot
    from service.endpoints.robots.task import make_scene as make_scene
    from service.endpoints.robots.task import make_tool as make_tool
    from service.endpoints.robots.task import prepare_robot as prepare_robot
    from service.endpoints.robots.task import prepare_scene as prepare_scene
    from service.endpoints.robots.task import robot_model as robot_model
    from service.endpoints.robots.task import robot_srdf as robot_srdf
    from service.endpoints.robots.task import robot_urdf as robot_urdf
    from service.endpoints.robots.task import unpack_robot as unpack_robot
    from service.endpoints.simulate.task import simulate as simulate
    from service.endpoints.tasks.task import plan_sequence as plan_sequence
    from service.endpoints.tours.task import tour as tour

    dynamics = dynamics_tasks.dynamics_task
    forward_dynamics = dynamics_tasks.forward_dynamics_task
    regressor = dynamics_tasks.regressor_task
    wrench = dynamics_tasks.wrench_task
    fk = kinematics_tasks.fk_task
    jacobian = kinematics_tasks.jacobian_task
    velocity = kinematics_tasks.velocity_task
else:
    cut = TaskReference("service.endpoints.batch.task:cut")
    plan_part = TaskReference("service.endpoints.batch.task:plan_part", GRACE + TURN)
    split = TaskReference("service.endpoints.batch.task:split")
    check = TaskReference("service.endpoints.check.task:check", GRACE)
    project = TaskReference("service.endpoints.check.task:project")
    dynamics = TaskReference("service.endpoints.dynamics.task:dynamics")
    forward_dynamics = TaskReference("service.endpoints.dynamics.task:forward_dynamics")
    regressor = TaskReference("service.endpoints.dynamics.task:regressor")
    wrench = TaskReference("service.endpoints.dynamics.task:wrench")
    equations = TaskReference("service.endpoints.dynamics.equations:equations")
    export = TaskReference("service.endpoints.export.task:export", GRACE)
    finger_poses = TaskReference("service.endpoints.robots.geometry:finger_poses")
    robot_geometry = TaskReference("service.endpoints.robots.geometry:robot_geometry")
    calibrate = TaskReference("service.endpoints.identification.task:calibrate", GRACE)
    excitation = TaskReference("service.endpoints.identification.task:excitation", GRACE)
    identify = TaskReference("service.endpoints.identification.task:identify")
    guard = TaskReference("service.endpoints.guard.task:guard", GRACE)
    guard_message = TaskReference("service.endpoints.guard.task:guard_message", GRACE)
    ik = TaskReference("service.endpoints.ik.task:ik", GRACE)
    fk = TaskReference("service.endpoints.kinematics.task:fk")
    jacobian = TaskReference("service.endpoints.kinematics.task:jacobian")
    velocity = TaskReference("service.endpoints.kinematics.task:velocity")
    outline = TaskReference("service.endpoints.large_body:outline")
    lyapunov = TaskReference("service.endpoints.lyapunov.task:lyapunov")
    plan = TaskReference("service.endpoints.plan.task:plan", GRACE)
    validate = TaskReference("service.endpoints.plan.task:validate", GRACE)
    convert_pose = TaskReference("service.endpoints.kinematics.task:convert_pose")
    potential = TaskReference("service.endpoints.potential.task:potential")
    reach = TaskReference("service.endpoints.reach.task:reach", GRACE)
    convert = TaskReference("service.endpoints.retime.task:convert")
    retime = TaskReference("service.endpoints.retime.task:retime")
    fit = TaskReference("service.endpoints.retime.task:fit", GRACE)
    simplify = TaskReference("service.endpoints.retime.task:simplify", GRACE)
    change_robot = TaskReference("service.endpoints.robots.task:change_robot")
    make_robot = TaskReference("service.endpoints.robots.task:make_robot")
    make_scene = TaskReference("service.endpoints.robots.task:make_scene")
    make_tool = TaskReference("service.endpoints.robots.task:make_tool")
    prepare_robot = TaskReference("service.endpoints.robots.task:prepare_robot")
    prepare_scene = TaskReference("service.endpoints.robots.task:prepare_scene")
    robot_model = TaskReference("service.endpoints.robots.task:robot_model")
    robot_srdf = TaskReference("service.endpoints.robots.task:robot_srdf")
    robot_urdf = TaskReference("service.endpoints.robots.task:robot_urdf")
    unpack_robot = TaskReference("service.endpoints.robots.task:unpack_robot")
    plan_sequence = TaskReference("service.endpoints.tasks.task:plan_sequence", GRACE)
    simulate = TaskReference("service.endpoints.simulate.task:simulate", GRACE)
    stop = TaskReference("service.endpoints.plans.stop:stop", GRACE)
    swept = TaskReference("service.endpoints.plans.program:swept")
    view = TaskReference("service.endpoints.plans.view:view")
    tour = TaskReference("service.endpoints.tours.task:tour", GRACE)
    witness = TaskReference("service.endpoints.plans.witness:witness", GRACE)
    audit = TaskReference("service.endpoints.plans.audit:audit", GRACE)

#: Modules that workers load: those that define the tasks.
MODULES = tuple(
    sorted(
        {one.name.partition(":")[0] for one in vars().values() if isinstance(one, TaskReference)}
    )
)


#: Ready once every kernel is loaded; what first requests would still compute comes after that.
RECIPE = Recipe(
    modules=MODULES,
    warm="service.warm_up.kernels:prepare",
    enrich="service.warm_up.kernels:enrich",
)
