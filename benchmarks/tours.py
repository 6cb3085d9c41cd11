"""Tours over drilling spots on a curved panel: time to the first tour, length, gap to the bound.

    python -m benchmarks.tours [--spots 50 150 300] [--timeout 60]

Spots lie on a panel bent about the vertical, the tool along its normal; the arm takes each of them
by up to eight branches. Clamps stand in the way between the spots.
"""

import argparse
import time

import numpy as np

import armwright as aw
from kinematics.arrays import Array
from planning.options import Options
from planning.preferred_clearance import PreferredClearance
from planning.problem import PoseGoal
from planning.tours.planner import plan_tour
from planning.tours.problem import TourGoal, TourOptions, TourProblem
from planning.tours.result import Tour

#: Radius of the panel [m].
_RADIUS = 0.6
#: Its distance from the base [m].
_DISTANCE = 0.62
#: Half its angle [rad].
_ANGLE = 0.75
#: Heights of spots [m].
_HEIGHTS = (0.25, 0.75)
#: Distance of the tool from the panel at a spot [m].
_STAND_OFF = 0.02
#: Where the tour begins and ends [rad].
_START = (0.0, -1.44, 2.5, 0.0, -1.07, 0.0)


def panel_problem(spots: int, robot: str = "kr6_sixx", seed: int = 0) -> TourProblem:
    """Drilling spots on a curved panel with clamps.

    Args:
        spots: How many.
        robot: Name of a built-in robot.
        seed: Of the places of the spots.
    """
    random = np.random.default_rng(seed)
    arm = aw.load_robot(robot)
    obstacles = [
        aw.Obstacle(f"panel_{k}", aw.Box((0.02, 0.17, 0.7)), _at(angle, 0.5, -0.011))
        for k, angle in enumerate(np.linspace(-_ANGLE, _ANGLE, 7))
    ]
    obstacles += [
        aw.Obstacle(f"clamp_{k}", aw.Box((0.12, 0.03, 0.05)), _at(angle, height, 0.06))
        for k, (angle, height) in enumerate(
            [(-0.5, 0.35), (-0.5, 0.65), (0.0, 0.4), (0.0, 0.6), (0.5, 0.35), (0.5, 0.65)]
        )
    ]
    scene = aw.Scene(obstacles)
    checker = aw.Checker.of(arm, scene)
    goals: list[TourGoal] = []
    while len(goals) < spots:
        angle, height = random.uniform(-_ANGLE, _ANGLE), random.uniform(*_HEIGHTS)
        T = _tool(angle, height)
        if any(checker.clearance(s.joints)[0] > 1e-4 for s in aw.ik(arm, T, most=16).solutions):
            goals.append(TourGoal(f"spot_{len(goals)}", (PoseGoal(T),)))
    return TourProblem(arm, scene, tuple(goals), np.array(_START), "start")


def _at(angle: float, height: float, off: float) -> Array:
    """Pose on the panel, x out of it towards the arm, ``off`` [m] away from it."""
    c, s = np.cos(angle), np.sin(angle)
    T = np.eye(4)
    T[:3, 0] = [-c, -s, 0.0]
    T[:3, 1] = [s, -c, 0.0]
    r = _RADIUS - off
    T[:3, 3] = [_DISTANCE - _RADIUS + r * c, r * s, height]
    return T


def _tool(angle: float, height: float) -> Array:
    """Pose of the tool at a spot: its z into the panel."""
    T = _at(angle, height, _STAND_OFF)
    turned = T.copy()
    turned[:3, 2], turned[:3, 0] = -T[:3, 0], [0.0, 0.0, -1.0]
    turned[:3, 1] = np.cross(turned[:3, 2], turned[:3, 0])
    return turned


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description="Tours over drilling spots.")
    parser.add_argument("--spots", nargs="+", type=int, default=[50, 150, 300])
    parser.add_argument("--timeout", type=float, default=60.0)
    chosen = parser.parse_args()
    for spots in chosen.spots:
        _measure(panel_problem(spots), chosen.timeout)


def _measure(problem: TourProblem, timeout: float) -> None:
    options = TourOptions(Options(timeout=timeout, clearance=PreferredClearance(0.0)))
    begin = time.perf_counter()
    first: list[float] = []

    def report(_share: float, stage: str) -> None:
        """Note when legs of the first tour are all proved and the search for better ones begins."""
        if stage == "improve" and not first:
            first.append(time.perf_counter() - begin)

    tour = plan_tour(problem, options, report)
    seconds = time.perf_counter() - begin
    if not isinstance(tour, Tour):
        print(f"{len(problem.goals)} spots: {tour.code}: {tour.message}")
        return
    work = tour.search
    print(
        f"{len(problem.goals)} spots, {work.configurations} configurations: {tour.time:.3f} s, "
        f"bound {tour.lower_bound:.3f} s; first round of proofs after "
        f"{first[0] if first else seconds:.2f} s, all after {seconds:.2f} s ({work.stopped}); "
        f"first proved tour {work.improvements[0].time:.3f} s; {work.checked} straight motions "
        f"checked, {work.blocked} blocked, {work.planned} legs proved"
    )


if __name__ == "__main__":
    main()
