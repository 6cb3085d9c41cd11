"""The configurations that a task's answer takes, what they cost, and why not others."""

from dataclasses import replace

import numpy as np

from planning.goal_choice.chosen_configuration import chosen_configuration
from planning.result import ChosenConfiguration
from planning.sequence.configuration_costs import ConfigurationCosts
from planning.sequence.estimate import travel_times
from planning.sequence.limit_avoidance import Replacement
from planning.sequence.node import Node
from planning.sequence.result import StagePlan
from planning.sequence.target_finder import TargetFinder
from planning.sequence.task import Segment, Task
from planning.values.deadline import Deadline


def with_configurations(
    task: Task,
    finder: TargetFinder,
    costs: ConfigurationCosts,
    leaf: Node,
    stages: tuple[StagePlan, ...],
    replaced: dict[int, Replacement],
    deadline: Deadline,
) -> tuple[StagePlan, ...]:
    """The plans of a combination, those of poses with the configuration that was chosen.

    Args:
        task: The stages.
        finder: Knows the configurations of all targets.
        costs: What they cost.
        leaf: The last node of the combination.
        stages: Its plans, in order.
        replaced: What took the place of a configuration at a limit, by the number of its stage.
        deadline: The end of everything.
    """
    chosen: dict[int, ChosenConfiguration] = {}
    for node, segment in zip(leaf.path[1:], task.segments, strict=False):
        if node.target is None or node.target.T is None or segment.target is None:
            continue
        chosen[segment.target] = _configuration(
            task, finder, costs, node, segment, replaced.get(segment.target), deadline
        )
    return tuple(
        replace(stage, configuration=chosen[stage.index]) if stage.index in chosen else stage
        for stage in stages
    )


def _configuration(
    task: Task,
    finder: TargetFinder,
    costs: ConfigurationCosts,
    node: Node,
    segment: Segment,
    replacement: Replacement | None,
    deadline: Deadline,
) -> ChosenConfiguration:
    parent, k = node.parent, segment.target
    assert parent is not None
    assert parent.onward_world is not None
    assert parent.onward_joints is not None
    assert k is not None
    assert segment.free is not None
    world = parent.onward_world.after_motion(free=True)
    rows = [
        finder.find(k, world, batch, parent.history, deadline).joints
        for batch in range(parent.batches or 1)
    ]
    found = np.concatenate(rows)
    if not (found == node.joints).all(axis=1).any():
        found = np.concatenate([found, node.joints[None]])  # It took the place of one at a limit.
    chain, options = world.robot.chain, task.stages[segment.free].settings.options
    begin = parent.onward_joints
    return chosen_configuration(
        chain, found, node.joints, begin,
        travel_times(chain, begin, found, options),
        costs.clearance(finder.cell(k, world).checker, node.joints),
        costs.weights, replacement,
    )  # fmt: skip
