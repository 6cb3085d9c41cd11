"""The tasks that the server asks workers to call, without the modules that they are in.

Those import all that computes: half a gigabyte of libraries that the server has no use for. A type
checker sees the tasks themselves; the server has their names. `service.tasks` has a test for each.
"""

from typing import TYPE_CHECKING

from service.tasks.chunk_sizes import TURN
from service.workers.task import GRACE, TaskReference

if TYPE_CHECKING:
    import service.tasks.batch
    import service.tasks.check
    import service.tasks.dynamics
    import service.tasks.equations
    import service.tasks.export
    import service.tasks.finger_poses
    import service.tasks.geometry
    import service.tasks.inverse_kinematics
    import service.tasks.kinematics
    import service.tasks.large_body
    import service.tasks.lyapunov
    import service.tasks.plan
    import service.tasks.poses
    import service.tasks.potential
    import service.tasks.reach
    import service.tasks.retime
    import service.tasks.robots
    import service.tasks.sequence
    import service.tasks.simulate
    import service.tasks.swept
    import service.tasks.tours
    import service.tasks.view

    cut = service.tasks.batch.cut
    plan_part = service.tasks.batch.plan_part
    split = service.tasks.batch.split
    check = service.tasks.check.check
    project = service.tasks.check.project
    dynamics = service.tasks.dynamics.dynamics_task
    forward_dynamics = service.tasks.dynamics.forward_dynamics_task
    regressor = service.tasks.dynamics.regressor_task
    wrench = service.tasks.dynamics.wrench_task
    equations = service.tasks.equations.equations
    export = service.tasks.export.export
    finger_poses = service.tasks.finger_poses.finger_poses
    robot_geometry = service.tasks.geometry.robot_geometry
    ik = service.tasks.inverse_kinematics.ik
    fk = service.tasks.kinematics.fk_task
    jacobian = service.tasks.kinematics.jacobian_task
    velocity = service.tasks.kinematics.velocity_task
    outline = service.tasks.large_body.outline
    lyapunov = service.tasks.lyapunov.lyapunov
    plan = service.tasks.plan.plan
    validate = service.tasks.plan.validate
    convert_pose = service.tasks.poses.convert_pose
    potential = service.tasks.potential.potential
    reach = service.tasks.reach.reach
    convert = service.tasks.retime.convert
    retime = service.tasks.retime.retime
    change_robot = service.tasks.robots.change_robot
    make_robot = service.tasks.robots.make_robot
    make_scene = service.tasks.robots.make_scene
    prepare_robot = service.tasks.robots.prepare_robot
    prepare_scene = service.tasks.robots.prepare_scene
    robot_model = service.tasks.robots.robot_model
    robot_srdf = service.tasks.robots.robot_srdf
    robot_urdf = service.tasks.robots.robot_urdf
    unpack_robot = service.tasks.robots.unpack_robot
    plan_sequence = service.tasks.sequence.plan_sequence
    simulate = service.tasks.simulate.simulate
    swept = service.tasks.swept.swept
    view = service.tasks.view.view
    tour = service.tasks.tours.tour
else:
    cut = TaskReference("service.tasks.batch:cut")
    plan_part = TaskReference("service.tasks.batch:plan_part", GRACE + TURN)
    split = TaskReference("service.tasks.batch:split")
    check = TaskReference("service.tasks.check:check", GRACE)
    project = TaskReference("service.tasks.check:project")
    dynamics = TaskReference("service.tasks.dynamics:dynamics")
    forward_dynamics = TaskReference("service.tasks.dynamics:forward_dynamics")
    regressor = TaskReference("service.tasks.dynamics:regressor")
    wrench = TaskReference("service.tasks.dynamics:wrench")
    equations = TaskReference("service.tasks.equations:equations")
    export = TaskReference("service.tasks.export:export", GRACE)
    finger_poses = TaskReference("service.tasks.finger_poses:finger_poses")
    robot_geometry = TaskReference("service.tasks.geometry:robot_geometry")
    ik = TaskReference("service.tasks.inverse_kinematics:ik", GRACE)
    fk = TaskReference("service.tasks.kinematics:fk")
    jacobian = TaskReference("service.tasks.kinematics:jacobian")
    velocity = TaskReference("service.tasks.kinematics:velocity")
    outline = TaskReference("service.tasks.large_body:outline")
    lyapunov = TaskReference("service.tasks.lyapunov:lyapunov")
    plan = TaskReference("service.tasks.plan:plan", GRACE)
    validate = TaskReference("service.tasks.plan:validate", GRACE)
    convert_pose = TaskReference("service.tasks.poses:convert_pose")
    potential = TaskReference("service.tasks.potential:potential")
    reach = TaskReference("service.tasks.reach:reach", GRACE)
    convert = TaskReference("service.tasks.retime:convert")
    retime = TaskReference("service.tasks.retime:retime")
    change_robot = TaskReference("service.tasks.robots:change_robot")
    make_robot = TaskReference("service.tasks.robots:make_robot")
    make_scene = TaskReference("service.tasks.robots:make_scene")
    prepare_robot = TaskReference("service.tasks.robots:prepare_robot")
    prepare_scene = TaskReference("service.tasks.robots:prepare_scene")
    robot_model = TaskReference("service.tasks.robots:robot_model")
    robot_srdf = TaskReference("service.tasks.robots:robot_srdf")
    robot_urdf = TaskReference("service.tasks.robots:robot_urdf")
    unpack_robot = TaskReference("service.tasks.robots:unpack_robot")
    plan_sequence = TaskReference("service.tasks.sequence:plan_sequence", GRACE)
    simulate = TaskReference("service.tasks.simulate:simulate", GRACE)
    swept = TaskReference("service.tasks.swept:swept")
    view = TaskReference("service.tasks.view:view")
    tour = TaskReference("service.tasks.tours:tour", GRACE)
