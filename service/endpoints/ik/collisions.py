"""Collision checks of the solutions of inverse kinematics."""

from typing import Any

import numpy as np

from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld, OverlapMeter
from service.endpoints.attached_objects import RobotInScene
from service.translate.contacts import allowed_answer

#: Collisions of one pose whose depth is measured: depths cost a thousand times as much as verdicts.
_MAX_DEPTHS = 8


class CollisionCheck:
    """A robot in a scene with which solutions are compared.

    Args:
        cell: The robot and its surroundings.
    """

    def __init__(self, cell: RobotInScene) -> None:
        self.cell = cell
        self._checker = Checker.of(cell.robot, cell.scene)
        self._world = FclWorld(cell.robot, cell.scene)
        self._meter = OverlapMeter(cell.robot, cell.scene)

    def told(self, answers: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """Pairs that are not kept apart, with how deep they are in the deepest of some answers."""
        return allowed_answer(self._meter.report(np.array(answer["joints"]) for answer in answers))

    def apply(self, answers: list[dict[str, Any]], *, everything: bool) -> list[dict[str, Any]]:
        """Solutions with their collisions, usable ones first.

        Args:
            answers: The solutions, best first; the result is written into them.
            everything: Check all of them, or stop at the first usable one.
        """
        checked: list[dict[str, Any]] = []
        depths = 0
        for answer in answers:
            q = np.array(answer["joints"])
            (clearance, pair), deep = self._checker.clearance(q), self._meter.too_deep(q)
            answer["collision_free"] = clearance > 0.0 and not deep
            why = deep[0][0].deeper(deep[0][1])[0] if deep else ""
            if clearance <= 0.0 and pair is not None:
                why = f"{pair[0]!r} and {pair[1]!r} overlap"
                if depths < _MAX_DEPTHS and (deepest := self._world.collisions(answer["joints"])):
                    a, b = deepest[0].pair
                    why = f"{a!r} and {b!r} overlap by {deepest[0].depth:.4g} m"
                    depths += 1
            if why:
                before = answer["rejected_because"]
                answer["rejected_because"] = why if before is None else f"{before}; {why}"
            checked.append(answer)
            if not everything and answer["collision_free"] and answer["within_limits"]:
                break
        checked.sort(key=lambda item: (not item["within_limits"], not item["collision_free"]))
        return checked
