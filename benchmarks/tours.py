"""Tours over drilling spots on a curved panel: time to the first tour, length, gap to the bound.

    python -m benchmarks.tours [--spots 50 150 300] [--timeout 60] [--peers PYTHON]

Spots lie on a panel bent about the vertical, the drill along its normal and free to turn about
itself; the arm takes each of them by eight free configurations (branches and turns). Clamps stand
in the way between the spots.

With ``--peers``, the interpreter of peers, `tour_peers` gets the same tables: that of straight
times to begin with, and the one that is known when the proved tour is. Their tours over the second
are checked and proved by the same code, and the table corrected, until the time is over.
"""

import argparse
import subprocess
import tempfile
import time
from itertools import pairwise
from pathlib import Path
from typing import ClassVar

import numpy as np

import armwright as aw
from kinematics.arrays import Array, Indices
from planning.deadline import Deadline
from planning.options import Options
from planning.preferred_clearance import PreferredClearance
from planning.problem import JointGoal
from planning.result import Failure
from planning.tours import planner
from planning.tours.legs import LegTable
from planning.tours.problem import TourGoal, TourOptions, TourProblem
from planning.tours.rest_to_rest import Times
from planning.tours.result import Tour
from planning.tours.search import TourSearch, Vain

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
#: Turns of the drill that are tried, and configurations of a spot that are taken.
_TURNS, BRANCHES = 8, 8
#: Tables that peers get one after another, corrected where their tour was blocked.
_TABLES = 6
PEERS = ("fast_tsp", "or_tools")
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
        turns = [_turned(T, turn) for turn in np.arange(_TURNS) * 2.0 * np.pi / _TURNS]
        found = [np.array(s.joints) for one in turns for s in aw.ik(arm, one, most=16).solutions]
        free = [q for q in found if checker.clearance(q)[0] > 1e-4]
        if len(free) >= BRANCHES:
            picked = random.choice(len(free), BRANCHES, replace=False)
            goals.append(TourGoal(f"spot_{len(goals)}", tuple(JointGoal(free[k]) for k in picked)))
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


def _turned(T: Array, turn: float) -> Array:
    """A pose turned about its own z [rad]."""
    c, s = np.cos(turn), np.sin(turn)
    about = np.eye(4)
    about[:2, :2] = [[c, -s], [s, c]]
    return np.array(T @ about)


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description="Tours over drilling spots.")
    parser.add_argument("--spots", nargs="+", type=int, default=[50, 150, 300])
    parser.add_argument("--timeout", type=float, default=60.0)
    parser.add_argument("--peers", help="their interpreter")
    chosen = parser.parse_args()
    for spots in chosen.spots:
        _measure(panel_problem(spots), chosen.timeout, chosen.peers)


class _Observed(TourSearch):
    """A search that notes what `plan_tour` does not tell."""

    searches: ClassVar[list["_Observed"]] = []
    straight: Times
    ordered: tuple[float, float]
    first: tuple[float, float] | None = None

    def run(self) -> Tour | Vain | Failure:
        """Search, the order by straight times apart."""
        self.searches.append(self)
        self.straight = self.legs.times.copy()
        self.began = _now()
        return super().run()

    def _settle(self, round_number: int) -> bool:
        if round_number == 0:
            self.ordered = (self._expected_time(), _now()[1] - self.began[1])
        return super()._settle(round_number)

    def _record(self, round_number: int) -> bool:
        shorter = super()._record(round_number)
        if shorter and self.first is None:
            self.first = _now()
        return shorter


def _now() -> tuple[float, float]:
    """The clock and the processor time [s]."""
    return time.perf_counter(), time.process_time()


def _measure(problem: TourProblem, timeout: float, peers: str | None) -> None:
    options = TourOptions(Options(timeout=timeout, clearance=PreferredClearance(0.0)))
    begin, computed = _now()
    vars(planner)["TourSearch"] = _Observed
    tour = planner.plan_tour(problem, options)
    seconds = time.perf_counter() - begin
    search = _Observed.searches.pop()
    if not isinstance(tour, Tour):
        print(f"{len(problem.goals)} spots: {tour.code}: {tour.message}")
        return
    work = tour.search
    print(
        f"{len(problem.goals)} spots, {work.configurations} configurations: {tour.time:.3f} s, "
        f"bound {tour.lower_bound:.3f} s; all after {seconds:.2f} s ({work.stopped}), "
        f"{time.process_time() - computed:.2f} s of processor time; {work.checked} straight "
        f"motions checked, {work.blocked} blocked, {work.planned} legs proved"
    )
    assert search.first is not None
    print(
        f"  first proved tour {work.improvements[0].time:.3f} s after "
        f"{search.first[0] - begin:.2f} s, {search.first[1] - computed:.2f} s of processor time; "
        f"order by straight times {search.ordered[0]:.3f} s after {search.ordered[1]:.2f} s of it"
    )
    for name in PEERS if peers else ():
        assert peers is not None
        _compare(name, peers, timeout, search, tour.time)


def _compare(name: str, python: str, seconds: float, search: _Observed, ours: float) -> None:
    """Tours of a peer: by straight times alone, and proved."""
    first, legs = search.stops.first, search.legs
    found = _ask(name, python, search.straight, first, seconds)
    if found is None:
        return
    straight = sum(float(search.straight[a, b]) for a, b in pairwise(found))
    print(
        f"  {name}: order by straight times {straight:.3f} s after {seconds:g} s: ours is "
        f"{100.0 * (search.ordered[0] / straight - 1.0):+.2f} % longer"
    )
    best = np.inf
    for _ in range(_TABLES):
        found = _ask(name, python, legs.times, first, seconds / _TABLES)
        best = min(best, _proved_time(legs, found or []))
    print(f"  {name}: proved {best:.3f} s: ours is {100.0 * (ours / best - 1.0):+.2f} % longer")


def _ask(name: str, python: str, times: Times, first: Indices, seconds: float) -> list[int] | None:
    """Configurations of a peer's tour from the start back to it; None where it has none."""
    depot, count = int(first[-3]), len(first) - 3
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.npz"
        np.savez(path, times=times[: depot + 1, : depot + 1], first=first[: count + 1])
        script = str(Path(__file__).with_name("tour_peers.py"))
        subprocess.run([python, script, str(path), str(seconds), name], check=True)
        answers = np.load(path.with_suffix("").with_suffix(".answers.npz"))
        if f"{name}_order" not in answers:
            return None
        order, choice = answers[f"{name}_order"], answers[f"{name}_choice"]
    if sorted(order) != list(range(count)):
        print(f"  {name}: no tour")
        return None
    return [depot, *(int(choice[k]) for k in order), depot + 1]


def _proved_time(legs: LegTable, found: list[int]) -> float:
    """Time of a tour whose legs are checked and proved; infinite if one is not."""
    total = 0.0 if found else np.inf
    for a, b in pairwise(found):
        legs.check(a, b)
        leg = legs.plan(a, b, Deadline.after(2.0))
        total += np.inf if isinstance(leg, Failure) else leg.trajectory.duration
    return total


if __name__ == "__main__":
    main()
