"""Equations of a robot as formulas, in workers."""

from typing import Literal

from armwright_wire.robot import RobotBody
from dynamics.equations.parameters import textbook_table
from dynamics.equations.sheet import write_sheet
from dynamics.equations.writing import Notation
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.model.chain import Chain
from kinematics.model.dh_table import DhTable
from service.endpoints.dynamics.formulas import equations_answer
from service.storage import worker_cache
from service.storage.cache_key import Reference
from service.translate.robots.robots import dh_table
from service.workers.answer import reports_cache_miss
from service.workers.result import CacheMiss
from service.workers.task import task

#: Answers that a worker keeps; those of arms with six joints have a few hundred kilobytes.
_KEPT_ANSWERS = 16


@task
@reports_cache_miss
def equations(
    robot: Reference, document: bytes | None, notation: Literal["latex", "text"]
) -> bytes | CacheMiss:
    """Answer a request for the formulas of a robot.

    Args:
        robot: The robot.
        document: Its stored document; None for a built-in one.
        notation: How formulas are written.

    Raises:
        InvalidRobotDescription: The tip does not move with the last joint.
        InvalidOption: The robot has so many joints that its formulas are too long to be read.
    """
    return _equations(worker_cache.chain(robot), document, Notation(notation))


@bounded_cache(maxsize=_KEPT_ANSWERS)
def _equations(chain: Chain, document: bytes | None, notation: Notation) -> bytes:
    sheet = write_sheet(_table(chain, document), notation)
    return equations_answer(chain, sheet).model_dump_json().encode()


def _table(chain: Chain, document: bytes | None) -> DhTable:
    """The table that a robot was given as if its tip is the tool, or one that fits its axes."""
    body = None if document is None else RobotBody.model_validate_json(document)
    given = None if body is None or body.tip_link not in (None, "tool") else dh_table(body)
    return given or textbook_table(chain)
