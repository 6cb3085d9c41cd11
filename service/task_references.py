"""The tasks that the server asks workers to call, without the modules that they are in.

Those import all that computes: half a gigabyte of libraries that the server has no use for. A type
checker sees the tasks themselves; the server reads their names in this file, each held by a test.
"""

import ast
from pathlib import Path
from typing import TYPE_CHECKING, Any

from service.workers.chunk_sizes import TURN
from service.workers.fork.launch import Recipe
from service.workers.task import GRACE, TaskReference

if TYPE_CHECKING:
    from service.endpoints.batch.task import cut as cut
    from service.endpoints.batch.task import plan_part as plan_part
    from service.endpoints.batch.task import split as split
    from service.endpoints.check.task import check as check
    from service.endpoints.check.task import project as project
    from service.endpoints.dynamics.equations import equations as equations
    from service.endpoints.dynamics.task import dynamics_task as dynamics_task
    from service.endpoints.dynamics.task import forward_dynamics_task as forward_dynamics_task
    from service.endpoints.dynamics.task import regressor_task as regressor_task
    from service.endpoints.dynamics.task import wrench_task as wrench_task
    from service.endpoints.export.task import export as export
    from service.endpoints.guard.task import guard as guard
    from service.endpoints.guard.task import guard_message as guard_message
    from service.endpoints.identification.task import calibrate as calibrate
    from service.endpoints.identification.task import excitation as excitation
    from service.endpoints.identification.task import identify as identify
    from service.endpoints.ik.task import ik as ik
    from service.endpoints.kinematics.task import convert_pose as convert_pose
    from service.endpoints.kinematics.task import fk_task as fk_task
    from service.endpoints.kinematics.task import jacobian_task as jacobian_task
    from service.endpoints.kinematics.task import velocity_task as velocity_task
    from service.endpoints.large_body import outline as outline
    from service.endpoints.lyapunov.task import lyapunov as lyapunov
    from service.endpoints.plan.task import plan as plan
    from service.endpoints.plan.task import validate as validate
    from service.endpoints.plans.audit import audit as audit
    from service.endpoints.plans.stop import stop as stop
    from service.endpoints.plans.stop import witness as witness
    from service.endpoints.plans.view import swept as swept
    from service.endpoints.plans.view import view as view
    from service.endpoints.potential.task import potential as potential
    from service.endpoints.reach.task import reach as reach
    from service.endpoints.retime.task import convert as convert
    from service.endpoints.retime.task import fit as fit
    from service.endpoints.retime.task import retime as retime
    from service.endpoints.retime.task import simplify as simplify
    from service.endpoints.robots.task import change_robot as change_robot
    from service.endpoints.robots.task import finger_poses as finger_poses
    from service.endpoints.robots.task import make_robot as make_robot
    from service.endpoints.robots.task import make_scene as make_scene
    from service.endpoints.robots.task import make_tool as make_tool
    from service.endpoints.robots.task import prepare_robot as prepare_robot
    from service.endpoints.robots.task import prepare_scene as prepare_scene
    from service.endpoints.robots.task import robot_geometry as robot_geometry
    from service.endpoints.robots.task import robot_model as robot_model
    from service.endpoints.robots.task import robot_srdf as robot_srdf
    from service.endpoints.robots.task import robot_urdf as robot_urdf
    from service.endpoints.robots.task import unpack_robot as unpack_robot
    from service.endpoints.simulate.task import simulate as simulate
    from service.endpoints.tasks.task import plan_sequence as plan_sequence
    from service.endpoints.tours.task import tour as tour

#: Package of the tasks; a wheel has it at a longer name.
_PLACE = "service.endpoints"
#: Grace of the tasks that mind their deadline themselves; at it, workers with others are ended.
_GRACES = {
    "plan_part": GRACE + TURN,
    **dict.fromkeys(
        (
            "audit",
            "calibrate",
            "check",
            "excitation",
            "export",
            "fit",
            "guard",
            "guard_message",
            "ik",
            "plan",
            "plan_sequence",
            "reach",
            "simplify",
            "simulate",
            "stop",
            "tour",
            "validate",
            "witness",
        ),
        GRACE,
    ),
}


def _references() -> dict[str, TaskReference[..., Any]]:
    """Reference of each task that this file imports for type checkers."""
    found: dict[str, TaskReference[..., Any]] = {}
    for node in ast.walk(ast.parse(Path(__file__).read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith(_PLACE):
            for task in [item.name for item in node.names]:
                name = f"{node.module}:{task.removesuffix('_task')}"
                found[task] = TaskReference(name, _GRACES.get(task, 0.0))
    return found


_REFERENCES = _references()
if not TYPE_CHECKING:
    globals().update(_REFERENCES)

#: Modules that workers load: those that define the tasks.
MODULES = tuple(sorted({one.name.partition(":")[0] for one in _REFERENCES.values()}))
#: Ready once every kernel is loaded; what first requests would still compute comes after that.
RECIPE = Recipe(
    modules=MODULES,
    warm="service.warm_up.kernels:prepare",
    enrich="service.warm_up.kernels:enrich",
)
