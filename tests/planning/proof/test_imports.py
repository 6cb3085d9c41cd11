"""Imports of the proof: plain values of planning, and of obstacles what no planner decides with.

The import contract of pyproject.toml names what is forbidden; here all that is allowed is named, so
that a module that is added later is not allowed by having been forgotten.
"""

import ast
from pathlib import Path

import planning.proof

ALLOWED = {
    "planning.constraints.constraint_set",
    "planning.constraints.kinds.constraint",
    "planning.constraints.row",
    "planning.values.deadline",
    "planning.values.limits",
    "planning.values.finger_motion",
    "planning.tool_motions.timed_tool_motions",
    "planning.tool_motions.tool_corner",
    "planning.tool_motions.tool_motion",
    "planning.tool_motions.tool_tolerance",
    "obstacles.robots.allowed_pairs",
    "obstacles.distance.bvh",
    "obstacles.distance.signed_distance",
    "obstacles.robots.finger_geometry",
    "obstacles.convex.piece",
    "obstacles.shapes.primitives",
    "obstacles.robots.robot_geometry",
    "obstacles.scenes.scene",
    "dynamics.model.body",
}
#: The seam to GJK, whose proposals are checked.
SEAM = {
    "obstacles.distance.epa",
    "obstacles.distance.gjk",
    "obstacles.distance.piece_set",
    "obstacles.distance.scene_set",
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
    files = sorted(Path(folder).rglob("*.py"))
    assert len(files) > 30
    for path in files:
        ours = {
            name
            for name in imported(path)
            if name.split(".")[0] in {"planning", "obstacles", "dynamics", "tracking", "service"}
            and not name.startswith("planning.proof.")
        }
        allowed = ALLOWED | (SEAM if path.name == "proposals.py" else set())
        assert ours <= allowed, path.name
