"""Equations of a robot as formulas, in workers."""

from dataclasses import asdict
from typing import Any, Literal

from pydantic_core import to_json

from armwright_wire.robots.robot import RobotBody
from dynamics.equations.formula import Notation
from dynamics.equations.sheet import Motion, Sheet, write_page, write_sheet
from dynamics.equations.table import textbook_table
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.model.chain import Chain
from kinematics.model.dh import DhTable
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.translate.robots.robots import dh_table
from service.workers.task import task


def _answer(chain: Chain, sheet: Sheet) -> dict[str, Any]:
    """The formulas of a robot as they are answered."""
    kinds = [row.type for row in sheet.table.rows]
    joints = zip(chain.joint_names, sheet.joints, kinds, strict=True)
    return {
        "format": "latex" if sheet.notation is Notation.LATEX else "text",
        "convention": sheet.table.convention,
        "joints": [
            {"joint": name, "symbol": symbol, "type": kind} for name, symbol, kind in joints
        ],
        "parameters": [asdict(item) for item in sheet.parameters],
        "abbreviations": [
            {"symbol": symbol, "formula": formula} for symbol, formula in sheet.abbreviations
        ],
        "transformations": sheet.transformations,
        "pose": {
            "link": chain.tip_link,
            "position": [row[3] for row in sheet.frame],
            "rotation_matrix": [row[:3] for row in sheet.frame],
        },
        "jacobian": sheet.jacobian,
        "determinant": sheet.determinant,
        "dynamics": None if sheet.motion is None else _motion(sheet.motion),
        "notes": sheet.notes,
        "document": write_page(sheet),
    }


def _motion(motion: Motion) -> dict[str, Any]:
    names = ("i", "j", "k", "formula")
    symbols = motion.christoffel_symbols
    rows = symbols and [dict(zip(names, row, strict=True)) for row in symbols]
    return asdict(motion) | {"christoffel_symbols": rows}


#: Answers that a worker keeps; those of arms with six joints have a few hundred kilobytes.
_KEPT_ANSWERS = 16


@task
def equations(
    robot: Reference,
    document: bytes | None,
    notation: Literal["latex", "text"],
    axes: tuple[str, ...] = (),
) -> bytes:
    """Answer a request for the formulas of a robot.

    Args:
        robot: The robot.
        document: Stored document of the robot; None for a built-in one.
        notation: How formulas are written.
        axes: Names of the rows of the Jacobian whose determinant is asked for.

    Raises:
        InvalidRobotDescription: The tip does not move with the last joint.
        InvalidOption: The robot has so many joints that its formulas are too long to be read, or
            the axes are not as many as joints.
    """
    return _equations(worker_cache.chain(robot), document, Notation(notation), axes)


@bounded_cache(maxsize=_KEPT_ANSWERS)
def _equations(
    chain: Chain, document: bytes | None, notation: Notation, axes: tuple[str, ...]
) -> bytes:
    sheet = write_sheet(_table(chain, document), notation, axes)
    return to_json(_answer(chain, sheet))


def _table(chain: Chain, document: bytes | None) -> DhTable:
    """The table that a robot was given as if its tip is the tool, or one that fits its axes."""
    body = None if document is None else RobotBody.model_validate_json(document)
    given = None if body is None or body.tip_link not in (None, "tool") else dh_table(body)
    return given or textbook_table(chain)
