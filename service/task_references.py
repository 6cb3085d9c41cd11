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
    from service.endpoints.batch.task import cut, split
    from service.endpoints.check.task import project
    from service.endpoints.dynamics.equations import equations
    from service.endpoints.dynamics.task import (
        dynamics_task,
        forward_dynamics_task,
        regressor_task,
        wrench_task,
    )
    from service.endpoints.identification.task import identify
    from service.endpoints.kinematics.task import (
        convert_pose,
        fk_task,
        jacobian_task,
        velocity_task,
    )
    from service.endpoints.large_body import outline
    from service.endpoints.lyapunov.task import lyapunov
    from service.endpoints.plans.view import swept, view
    from service.endpoints.potential.task import potential
    from service.endpoints.retime.task import convert, retime
    from service.endpoints.robots.task import (
        change_robot,
        finger_poses,
        make_robot,
        make_scene,
        make_tool,
        prepare_robot,
        prepare_scene,
        robot_geometry,
        robot_model,
        robot_srdf,
        robot_urdf,
        unpack_robot,
    )

# Tasks that mind their deadline themselves, which they get a grace for.
if TYPE_CHECKING:
    from service.endpoints.batch.task import plan_part
    from service.endpoints.check.task import check
    from service.endpoints.export.task import export
    from service.endpoints.guard.task import guard, guard_message
    from service.endpoints.identification.task import calibrate, excitation
    from service.endpoints.ik.task import ik
    from service.endpoints.plan.task import plan, validate
    from service.endpoints.plans.audit import audit
    from service.endpoints.plans.stop import stop, witness
    from service.endpoints.reach.task import reach
    from service.endpoints.retime.task import fit, simplify
    from service.endpoints.simulate.task import simulate
    from service.endpoints.tasks.task import plan_sequence
    from service.endpoints.tours.task import tour

#: Grace of the tasks of either block above; `plan_part` may go on for a turn.
_GRACES = (0.0, GRACE)
_PART_GRACE = {"plan_part": GRACE + TURN}


def _references() -> dict[str, TaskReference[..., Any]]:
    """Reference of each task that this file imports for type checkers."""
    found: dict[str, TaskReference[..., Any]] = {}
    statements = ast.parse(Path(__file__).read_text("utf-8")).body
    blocks = [node for node in statements if isinstance(node, ast.If)]
    for grace, block in zip(_GRACES, blocks, strict=False):
        for node in block.body:
            assert isinstance(node, ast.ImportFrom)
            for task in [item.name for item in node.names]:
                name = f"{node.module}:{task.removesuffix('_task')}"
                found[task] = TaskReference(name, _PART_GRACE.get(task, grace))
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
