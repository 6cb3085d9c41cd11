"""Imports of the proof: plain values of planning, and of obstacles what no planner decides with.

The import contract of pyproject.toml names what is forbidden; here all that is allowed is named, so
that a module that is added later is not allowed by having been forgotten.
"""

import ast
from pathlib import Path

import planning.proof

ALLOWED = {
    "planning.constraints.constraint_set",
    "planning.constraints.limit",
    "planning.constraints.row",
    "planning.deadline",
    "planning.effort_limits",
    "planning.finger_motion",
    "planning.limits",
    "planning.timed_tool_motions",
    "planning.tool_corner",
    "planning.tool_motion",
    "planning.tool_tolerance",
    "obstacles.allowed_pairs",
    "obstacles.bvh",
    "obstacles.convex_distance",
    "obstacles.finger_geometry",
    "obstacles.piece",
    "obstacles.primitives",
    "obstacles.robot_geometry",
    "obstacles.scene",
    "dynamics.body",
}
#: The seam to GJK, whose proposals are checked.
SEAM = {
    "obstacles.epa",
    "obstacles.gjk",
    "obstacles.piece_set",
    "obstacles.scene_set",
    "obstacles.support_table",
}


def imported(path: Path) -> set[str]:
    modules = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            modules.add(node.module)
        if isinstance(node, ast.Import):
            modules |= {name.name for name in node.names}
    return modules


def test_the_proof_imports_values_only() -> None:
    (folder,) = planning.proof.__path__
    files = sorted(Path(folder).glob("*.py"))
    assert len(files) > 10
    for path in files:
        ours = {
            name
            for name in imported(path)
            if name.split(".")[0] in {"planning", "obstacles", "dynamics", "tracking", "service"}
            and not name.startswith("planning.proof.")
        }
        allowed = ALLOWED | (SEAM if path.name == "proposals.py" else set())
        assert ours <= allowed, path.name
