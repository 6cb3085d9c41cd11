"""Drake's InverseKinematics on the problems that ``benchmarks.constrained_ik --write`` wrote.

    python3 -m venv PEER; PEER/bin/pip install drake
    PEER/bin/python benchmarks/constrained_ik_drake.py problems.json panda.urdf answers.json

It imports nothing of Armwright. As there, a problem has up to 100 random starts; SNOPT, the cost is
the distance from the middle of the limits. In shelves it has the same solids, and a bound of 2 cm
on the distance of links from obstacles; drake takes one bound for all pairs, so that the links'
pairs among each other are left out of the program, and its answers are judged for them afterwards.
Plants are built before the clock starts.
"""

# mypy: ignore-errors

import json
import logging
import re
import sys
import time
from pathlib import Path

import numpy as np
from pydrake.geometry import Box, CollisionFilterDeclaration, Convex, Cylinder, GeometrySet
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.solvers import SnoptSolver
from pydrake.systems.framework import DiagramBuilder

logging.getLogger("drake").setLevel(logging.ERROR)
UP = np.array([0.0, 0.0, 1.0])
STARTS = 100
#: How much farther than the bound pairs are looked at [m].
INFLUENCE = 0.05


class World:
    """The robot, among obstacles or alone."""

    def __init__(self, urdf, robot=(), obstacles=()):
        builder = DiagramBuilder()
        self.plant, graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        (model,) = Parser(self.plant).AddModelsFromString(urdf, "urdf")
        self.plant.WeldFrames(
            self.plant.world_frame(), self.plant.GetFrameByName("panda_link0", model)
        )
        links = [
            self._add(self.plant.GetBodyByName(one["link"]), one, f"link{i}")
            for i, one in enumerate(robot)
        ]
        for i, one in enumerate(obstacles):
            self._add(self.plant.world_body(), one, f"obstacle{i}")
        self.plant.Finalize()
        if links:
            own = CollisionFilterDeclaration().ExcludeWithin(GeometrySet(links))
            graph.collision_filter_manager().Apply(own)
        self.diagram = builder.Build()
        self.root = self.diagram.CreateDefaultContext()
        self.context = self.plant.GetMyMutableContextFromRoot(self.root)
        self.tip = self.plant.GetFrameByName("panda_link8")

    def _add(self, body, one, name):
        if "box" in one:
            shape = Box(*one["box"])
        elif "points" in one:
            shape = Convex(np.array(one["points"]).T, name, 1.0)
        else:
            shape = Cylinder(one["radius"], one["length"])
        placed = RigidTransform(np.array(one["T"]))
        return self.plant.RegisterCollisionGeometry(
            body, placed, shape, name, CoulombFriction(0.5, 0.5)
        )


def program(world, kind, entry):
    """The problem as drake's program."""
    ik = InverseKinematics(world.plant, world.context)
    tip, base = world.tip, world.plant.world_frame()
    if kind == "upright":
        axis, center = np.array(entry["axis"]), np.array(entry["center"])
        ik.AddAngleBetweenVectorsConstraint(base, UP, tip, axis, 0.0, entry["angle"])
        # A ball as the distance of two points.
        ik.AddPointToPointDistanceConstraint(tip, np.zeros(3), base, center, 0.0, entry["radius"])
        return ik
    T = RigidTransform(np.array(entry["T"]))
    if kind == "look_at":
        half = 0.5 * np.array(entry["size"])
        ik.AddGazeTargetConstraint(
            tip, np.zeros(3), np.array(entry["axis"]), base,
            np.array(entry["target"]), entry["angle"],
        )  # fmt: skip
        ik.AddPositionConstraint(tip, np.zeros(3), base, T, -half, half)
        return ik
    half = np.full(3, 0.01)
    ik.AddPositionConstraint(tip, np.zeros(3), base, T, -half, half)
    ik.AddOrientationConstraint(base, T.rotation(), tip, RotationMatrix(), 0.1)
    ik.AddMinimumDistanceLowerBoundConstraint(entry["margin"], INFLUENCE)
    return ik


def main() -> None:
    """Solve every problem and print one row a kind."""
    problems = json.loads(Path(sys.argv[1]).read_text())
    text = Path(sys.argv[2]).read_text()
    text = re.sub(r"<(visual|collision)>.*?</\1>", "", text, flags=re.DOTALL)
    count = int(sys.argv[4]) if len(sys.argv) > 4 else None
    alone = World(text)
    worlds = [World(text, problems["robot"], scene) for scene in problems["scenes"]]
    low, high = alone.plant.GetPositionLowerLimits(), alone.plant.GetPositionUpperLimits()
    middle, solver, answers = 0.5 * (low + high), SnoptSolver(), {}
    for kind in ("upright", "look_at", "shelf"):
        spent, starts, answers[kind] = [], [], []
        for i, entry in enumerate(problems[kind][:count]):
            random = np.random.default_rng(i)
            world = alone if entry["scene"] is None else worlds[entry["scene"]]
            began = time.process_time()
            for start in range(STARTS):
                ik = program(world, kind, entry)
                q = ik.q()
                ik.prog().AddQuadraticErrorCost(np.eye(len(q)), middle, q)
                guess = middle if start == 0 else random.uniform(low, high)
                result = solver.Solve(ik.prog(), guess)
                if result.is_success():
                    break
            spent.append(1e3 * (time.process_time() - began))
            starts.append(start + 1)
            found = result.GetSolution(q) if result.is_success() else None
            # Fingers come after the arm.
            answers[kind].append(None if found is None else found[:7].tolist())
        solved = sum(answer is not None for answer in answers[kind])
        print(
            f"{kind:8} drake {solved:4d} of {len(spent)} | ms median {np.median(spent):7.2f} "
            f"p95 {np.percentile(spent, 95):8.2f} max {max(spent):8.1f} "
            f"| starts {np.mean(starts):5.1f}",
            flush=True,
        )
        Path(sys.argv[3]).write_text(
            json.dumps(
                answers
                | {other: [] for other in ("upright", "look_at", "shelf") if other not in answers}
            )
        )


if __name__ == "__main__":
    main()
