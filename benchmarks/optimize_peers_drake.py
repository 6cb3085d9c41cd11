"""Drake's KinematicTrajectoryOptimization on what ``benchmarks.optimize_peers --write`` wrote.

    PEER/bin/python benchmarks/optimize_peers_drake.py FOLDER panda.urdf

It imports nothing of Armwright. Cubic B-splines with 16 control points of each joint, least time,
limits of velocity and acceleration, rest at both ends, a distance of 1 mm from obstacles at 25
places (pairs of links among each other left out, as drake's bound would be theirs too), SNOPT, from
the motion that is known. A plant is built before the clock starts.
"""

# mypy: ignore-errors

import re
import sys
import time
from pathlib import Path

import numpy as np
from constrained_ik_drake import FclWorld
from pydrake.math import BsplineBasis, KnotVectorType
from pydrake.multibody.inverse_kinematics import MinimumDistanceLowerBoundConstraint
from pydrake.planning import KinematicTrajectoryOptimization
from pydrake.solvers import SnoptSolver
from pydrake.trajectories import BsplineTrajectory

POINTS, PLACES, SPARE, INFLUENCE = 16, 25, 1e-3, 0.05


def optimise(world, known, duration, acceleration):
    """The motion found, and whether the solver says that it holds."""
    n = known.shape[1]
    program = KinematicTrajectoryOptimization(n, POINTS, 4, duration)
    basis = BsplineBasis(4, POINTS, KnotVectorType.kClampedUniform, 0.0, 1.0)
    u = np.linspace(0.0, 1.0, len(known))
    B = np.array([[basis.EvaluateBasisFunctionI(i, s) for i in range(POINTS)] for s in u])
    points = np.linalg.lstsq(B, known, rcond=None)[0]
    points[0], points[-1] = known[0], known[-1]
    scaled = BsplineBasis(4, POINTS, KnotVectorType.kClampedUniform, 0.0, duration)
    program.SetInitialGuess(BsplineTrajectory(scaled, [p[:, None] for p in points]))
    plant = world.plant
    low, high = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
    program.AddDurationCost(1.0)
    program.AddPositionBounds(low, high)
    program.AddVelocityBounds(plant.GetVelocityLowerLimits(), plant.GetVelocityUpperLimits())
    program.AddAccelerationBounds(-acceleration, acceleration)
    program.AddDurationConstraint(0.1, 3.0 * duration)
    zero = np.zeros((n, 1))
    for s, q in ((0.0, known[0]), (1.0, known[-1])):
        program.AddPathPositionConstraint(q, q, s)
        program.AddPathVelocityConstraint(zero, zero, s)
    apart = MinimumDistanceLowerBoundConstraint(
        plant, SPARE, world.context, influence_distance_offset=INFLUENCE
    )
    for s in np.linspace(0.0, 1.0, PLACES)[1:-1]:
        program.AddPathPositionConstraint(apart, s)
    result = SnoptSolver().Solve(program.prog())
    return program.ReconstructTrajectory(result), result.is_success()


def main() -> None:
    """Optimise every problem and write what was found."""
    folder = Path(sys.argv[1])
    text = re.sub(
        r"<(visual|collision)>.*?</\1>", "", Path(sys.argv[2]).read_text(), flags=re.DOTALL
    )
    for path in sorted(folder.glob("problem*.npz")):
        given = np.load(path, allow_pickle=True)
        robot = [one | {"link": f"panda_link{one['link']}"} for one in given["robot"]]
        world = FclWorld(text, robot, given["scene"])
        began = time.process_time()
        motion, held = optimise(
            world, given["known"], float(given["duration"]), given["acceleration"]
        )
        spent = 1e3 * (time.process_time() - began)
        end = motion.end_time()
        times = np.linspace(0.0, end, 4000)
        rates = [motion, motion.MakeDerivative(1), motion.MakeDerivative(2)]
        q, v, a = (np.array([one.value(t)[:, 0] for t in times]) for one in rates)
        print(
            f"{path.stem}: {float(given['duration']):.3f} s became {end:.3f} s in {spent:.0f} ms, "
            f"solver says {'held' if held else 'not held'}",
            flush=True,
        )
        none = np.zeros((0, 7))
        q, v, a = (q, v, a) if held else (none, none, none)
        name = path.name.replace("problem", "answer")
        np.savez(folder / name, q=q, v=v, a=a, duration=end, milliseconds=spent)


if __name__ == "__main__":
    main()
