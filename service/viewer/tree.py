"""The tree or roadmap of a planner as lines of the tool, for a page."""

import base64
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.model.chain import Chain
from planning.values.search_trees import WHOLE, Edge, Explored

#: Straight pieces of a line: the tool moves on a curve while the joints move straight.
_PIECES = 3


def tree_document(chain: Chain, explored: Explored) -> dict[str, Any]:
    """The edges that a planner explored, as JSON.

    Args:
        chain: The robot.
        explored: Its edges.
    """
    parts = sorted({edge.part for edge in explored.edges}, reverse=True)
    return {
        "planner": explored.planner,
        "runs": explored.runs,
        "edges": len(explored.edges),
        "left_out": explored.left_out,
        "parts": [
            {"name": part, "points": _points(chain, [e for e in explored.edges if e.part == part])}
            for part in parts
        ],
    }


def tree_sentence(explored: Explored) -> str:
    """A sentence about the tree that is drawn.

    Args:
        explored: What was explored when the request was planned once more.
    """
    if explored.planner is None:
        return "No planner with a tree or a roadmap had its turn when this was planned once more."
    kind = "edges" if any(e.part == WHOLE for e in explored.edges) else "edges of two trees"
    run = "" if explored.runs == 1 else f", in run {explored.runs}"
    words = f"{explored.planner} explored {len(explored.edges) + explored.left_out} {kind}{run}"
    drawn = f"; the first {len(explored.edges)} are drawn" if explored.left_out else ""
    return f"Planned once more, {words}{drawn}."


def _points(chain: Chain, edges: list[Edge]) -> str:
    """Positions of the tip along edges, shape (k, pieces + 1, 3), float32 in base64."""
    begins, ends = (np.array([edge[k] for edge in edges], dtype=float) for k in (0, 1))
    shares = np.linspace(0.0, 1.0, _PIECES + 1)[:, None]
    rows: Array = begins[:, None] + shares * (ends - begins)[:, None]
    at = forward(chain, rows)[..., :3, 3]
    return base64.b64encode(np.ascontiguousarray(at, dtype="<f4").tobytes()).decode()
