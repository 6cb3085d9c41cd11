"""Options common to requests about a robot among obstacles, fields of those requests."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias, TypedDict

from armwright_wire.goals.goal import GoalCosts
from armwright_wire.motions.timing import Timing
from armwright_wire.motions.trajectory import LimitsBody
from armwright_wire.scenes.check import AllowedCollisions, Attached
from armwright_wire.scenes.scene import SceneReference
from armwright_wire.scenes.tool import Margins, TipReference, ToolReference

#: An object whose fields the models of requests check.
Options: TypeAlias = Mapping[str, Any]


class ToolOptions(TypedDict, total=False):
    """Options of any request about a robot with a tool.

    Args:
        tool: Tool that is mounted meanwhile: name of a stored or built-in one, or a tool.
        tcp: Tip of it, or that of an attached object; may be left out where the tool has one.
        margins: Distances that links and objects keep [m].
    """

    tool: ToolReference | None
    tcp: TipReference | None
    margins: Margins | None


class SceneOptions(ToolOptions, total=False):
    """Options of any request about a robot among obstacles.

    Args:
        scene: Obstacles: the name of a stored scene, or a scene.
        frame: Frame of poses and of an inline scene that name none: a link that stands still, or
            "tool" at the start.
        attached: Objects that move with a link.
        allowed_collisions: Pairs that may touch, beside those of the robot and the scene.
        timeout: Time for the whole request [s].
    """

    scene: SceneReference | None
    frame: str | None
    attached: Sequence[Attached | Options] | None
    allowed_collisions: AllowedCollisions | None
    timeout: float | None


class PlanningOptions(SceneOptions, total=False):
    """Options of any request that plans motions.

    Args:
        margin: Distance to be kept from obstacles [m].
        timing: Speeds, and how time is found.
        limits: Limits of the joints, in place of the robot's.
        goal_costs: Costs of the configurations of a pose, of which the cheapest is taken.
        seed: Seed of all random choices: the same seed, the same answer.
        keep: Whether request and answer are kept as a plan, see `Client.plans`.
    """

    margin: float
    timing: Timing
    limits: LimitsBody | None
    goal_costs: GoalCosts | None
    seed: int
    keep: bool
