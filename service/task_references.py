"""The tasks that the server asks workers to call, without the modules that they are in.

Those import all that computes: half a gigabyte of libraries that the server has no use for. A type
checker sees the tasks themselves; the server has their names, each held by a test.
"""

from typing import TYPE_CHECKING

from service.workers.chunk_sizes import TURN
from service.workers.task import GRACE, TaskReference

if TYPE_CHECKING:
    import service.endpoints.batch.task
    import service.endpoints.check.task
    import service.endpoints.dynamics.equations
    import service.endpoints.dynamics.task
    import service.endpoints.export.task
    import service.endpoints.ik.task
    import service.endpoints.kinematics.task
    import service.endpoints.large_body
    import service.endpoints.lyapunov.task
    import service.endpoints.plan.task
    import service.endpoints.plans.stop
    import service.endpoints.plans.swept
    import service.endpoints.plans.view
    import service.endpoints.plans.witness
    import service.endpoints.potential.task
    import service.endpoints.reach.task
    import service.endpoints.retime.task
    import service.endpoints.robots.geometry
    import service.endpoints.robots.task
    import service.endpoints.simulate.task
    import service.endpoints.tasks.task
    import service.endpoints.tours.task

    cut = service.endpoints.batch.task.cut
    plan_part = service.endpoints.batch.task.plan_part
    split = service.endpoints.batch.task.split
    check = service.endpoints.check.task.check
    project = service.endpoints.check.task.project
    dynamics = service.endpoints.dynamics.task.dynamics_task
    forward_dynamics = service.endpoints.dynamics.task.forward_dynamics_task
    regressor = service.endpoints.dynamics.task.regressor_task
    wrench = service.endpoints.dynamics.task.wrench_task
    equations = service.endpoints.dynamics.equations.equations
    export = service.endpoints.export.task.export
    finger_poses = service.endpoints.robots.geometry.finger_poses
    robot_geometry = service.endpoints.robots.geometry.robot_geometry
    ik = service.endpoints.ik.task.ik
    fk = service.endpoints.kinematics.task.fk_task
    jacobian = service.endpoints.kinematics.task.jacobian_task
    velocity = service.endpoints.kinematics.task.velocity_task
    outline = service.endpoints.large_body.outline
    lyapunov = service.endpoints.lyapunov.task.lyapunov
    plan = service.endpoints.plan.task.plan
    validate = service.endpoints.plan.task.validate
    convert_pose = service.endpoints.kinematics.task.convert_pose
    potential = service.endpoints.potential.task.potential
    reach = service.endpoints.reach.task.reach
    convert = service.endpoints.retime.task.convert
    retime = service.endpoints.retime.task.retime
    simplify = service.endpoints.retime.task.simplify
    change_robot = service.endpoints.robots.task.change_robot
    make_robot = service.endpoints.robots.task.make_robot
    make_scene = service.endpoints.robots.task.make_scene
    make_tool = service.endpoints.robots.task.make_tool
    prepare_robot = service.endpoints.robots.task.prepare_robot
    prepare_scene = service.endpoints.robots.task.prepare_scene
    robot_model = service.endpoints.robots.task.robot_model
    robot_srdf = service.endpoints.robots.task.robot_srdf
    robot_urdf = service.endpoints.robots.task.robot_urdf
    unpack_robot = service.endpoints.robots.task.unpack_robot
    plan_sequence = service.endpoints.tasks.task.plan_sequence
    simulate = service.endpoints.simulate.task.simulate
    stop = service.endpoints.plans.stop.stop
    swept = service.endpoints.plans.swept.swept
    view = service.endpoints.plans.view.view
    tour = service.endpoints.tours.task.tour
    witness = service.endpoints.plans.witness.witness
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
    swept = TaskReference("service.endpoints.plans.swept:swept")
    view = TaskReference("service.endpoints.plans.view:view")
    tour = TaskReference("service.endpoints.tours.task:tour", GRACE)
    witness = TaskReference("service.endpoints.plans.witness:witness", GRACE)

#: Modules that workers load: those that define the tasks.
MODULES = tuple(
    sorted(
        {one.name.partition(":")[0] for one in vars().values() if isinstance(one, TaskReference)}
    )
)
