"""Candidates of stages in the worlds of a search, each found once."""

from kinematics.arrays import Array
from obstacles.robots.allowed_pairs import contacts_of
from planning.sequence.node import contact_pairs
from planning.sequence.stage import Move
from planning.sequence.target import (
    Candidates,
    find_candidates,
    stage_targets,
    target_count,
)
from planning.sequence.task import Task
from planning.sequence.world import Cell, Cells, World
from planning.values.deadline import Deadline

#: Targets of a stage that are looked at together; each batch is spread over the whole list.
_BATCH = 256


class TargetFinder:
    """Finds valid configurations of targets, and keeps them.

    Args:
        task: The stages.
        cells: Cells that were put together.
    """

    def __init__(self, task: Task, cells: Cells) -> None:
        self._task, self._cells = task, cells
        self._candidates: dict[object, Candidates] = {}

    def batches(self, k: int) -> int:
        """Number of batches of a stage's targets."""
        return -(-target_count(self._task.stages[k]) // _BATCH)

    def find(
        self, k: int, world: World, batch: int, history: dict[int, Array], deadline: Deadline
    ) -> Candidates:
        """Valid configurations of a batch of a stage's targets.

        Args:
            k: Number of the stage.
            world: The world before its motion.
            batch: Number of the batch.
            history: Configurations at the ends of earlier stages, by number.
            deadline: When to look at no more targets.
        """
        stage = self._task.stages[k]
        back = stage.to_end_of if isinstance(stage, Move) else None
        key = (k, batch, world.key, None if back is None else history[back].tobytes())
        if key not in self._candidates:
            targets = stage_targets(stage, world, history)[batch :: self.batches(k)]
            cell = self.cell(k, world)
            self._candidates[key] = find_candidates(
                cell.robot.chain, targets, cell.checker, deadline, self._task.seed
            )
        return self._candidates[key]

    def cell(self, k: int, world: World) -> Cell:
        """The cell that configurations of a stage's targets are valid in.

        Args:
            k: Number of the stage.
            world: The world before its motion.
        """
        stage = self._task.stages[k]
        allowed = contact_pairs(stage) | contacts_of(stage.settings.allowed, "request")
        return self._cells.cell(world, allowed, stage.settings.margin)
