"""Drake's InverseKinematics on the problems that ``benchmarks.constrained_ik --write`` wrote.

    python3 -m venv PEER; PEER/bin/pip install drake
    PEER/bin/python benchmarks/constrained_ik_drake.py problems.json path/to/panda.urdf

It imports nothing of Armwright. As there, a problem has up to 100 random starts; SNOPT, the cost is
the distance from the middle of the limits.
"""

# mypy: ignore-errors

import json
import re
import sys
import time
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.solvers import SnoptSolver

UP = np.array([0.0, 0.0, 1.0])
STARTS = 100


def main() -> None:
    """Solve every problem and print one row a kind."""
    problems = json.loads(Path(sys.argv[1]).read_text())
    text = Path(sys.argv[2]).read_text()
    # Meshes play no part here.
    text = re.sub(r"<(visual|collision)>.*?</\1>", "", text, flags=re.DOTALL)
    plant = MultibodyPlant(0.0)
    (model,) = Parser(plant).AddModelsFromString(text, "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("panda_link0", model))
    plant.Finalize()
    tip, world = plant.GetFrameByName("panda_link8"), plant.world_frame()
    low, high = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
    middle = 0.5 * (low + high)
    solver = SnoptSolver()
    for kind, entries in problems.items():
        spent, solved, starts = [], 0, []
        for i, entry in enumerate(entries):
            random = np.random.default_rng(i)
            began = time.process_time()
            for start in range(STARTS):
                ik = InverseKinematics(plant)
                q = ik.q()
                if kind == "upright":
                    c, r = np.array(entry["center"]), entry["radius"]
                    ik.AddAngleBetweenVectorsConstraint(
                        world, UP, tip, np.array(entry["axis"]), 0.0, entry["angle"]
                    )
                    # A ball as the distance of two points.
                    ik.AddPointToPointDistanceConstraint(tip, np.zeros(3), world, c, 0.0, r)
                else:
                    T, half = np.array(entry["T"]), 0.5 * np.array(entry["size"])
                    ik.AddGazeTargetConstraint(
                        tip, np.zeros(3), np.array(entry["axis"]), world,
                        np.array(entry["target"]), entry["angle"],
                    )  # fmt: skip
                    ik.AddPositionConstraint(
                        tip, np.zeros(3), world, RigidTransform(T), -half, half
                    )
                ik.prog().AddQuadraticErrorCost(np.eye(len(q)), middle, q)
                guess = middle if start == 0 else random.uniform(low, high)
                result = solver.Solve(ik.prog(), guess)
                if result.is_success():
                    break
            spent.append(1e3 * (time.process_time() - began))
            solved += result.is_success()
            starts.append(start + 1)
        print(
            f"{kind:8} drake {solved:4d} of {len(entries)} | ms median {np.median(spent):7.2f} "
            f"p95 {np.percentile(spent, 95):8.2f} max {max(spent):8.1f} "
            f"| starts {np.mean(starts):5.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
