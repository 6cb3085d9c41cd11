"""One request to one of OMPL's planners: seeded, watched, and its answer checked again.

OMPL gets a state space of the arm, and a motion validator that proves whole edges.

Probabilistic roadmaps: OMPL grows them, the shortest path through them is found here.

OMPL's own search runs in a second thread beside the growing, so its answer depends on how fast
each of them is. Every edge of the roadmap was proved through ``CertifiedEdges``, which keeps them.

Stopping rules of a planner, and its progress until then.
"""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import scipy
from ompl import base, geometric, util

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from obstacles.collision.checker import Checker
from planning.planner import Query
from planning.result import Attempt, Progress
from planning.sampling.planners import Planner, Value, complete_options, planner_by_name
from planning.values.deadline import Deadline
from planning.values.search_box import search_box
from planning.values.search_trees import Explored

util.setLogLevel(util.LogLevel.LOG_NONE)


def joint_space(chain: Chain, known: list[Array]) -> Any:
    """The box of the joint limits; a turn beyond the known configurations where there are none."""
    lower, upper = search_box(chain, known)
    bounds = base.RealVectorBounds(chain.n)
    for j in range(chain.n):
        bounds.setLow(j, float(lower[j]))
        bounds.setHigh(j, float(upper[j]))
    space = base.RealVectorStateSpace(chain.n)
    space.setBounds(bounds)
    return space


def state_of(space: Any, q: Array) -> Any:
    """A configuration as a state of OMPL."""
    state = space.allocState()
    state[0 : len(q)] = [float(value) for value in q]
    return state


class CertifiedEdges(base.MotionValidator):
    """The motion validator: OMPL's planners only ever get edges that are proved.

    Args:
        information: OMPL's space information.
        checker: Proves edges.
        n: Number of joints.
        deadline: Afterwards nothing is proved any more, so that a planner in the midst of a long
            round comes to its end.
    """

    def __init__(self, information: Any, checker: Checker, n: int, deadline: Deadline) -> None:
        super().__init__(information)
        self._checker = checker
        self._n = n
        self._deadline = deadline
        self.count = 0
        self.proved: list[tuple[Array, Array]] | None = None
        self.explored: Explored | None = None

    def checkMotion(self, a: Any, b: Any) -> bool:
        """Whether the straight motion from a to b is proved free."""
        if self._deadline.passed:
            return False
        self.count += 1
        start, end = np.array(a[0 : self._n]), np.array(b[0 : self._n])
        free = self._checker.free(start, end)
        if free and self.proved is not None:
            self.proved.append((start, end))
        if free and self.explored is not None:
            self.explored.add(start, end)
        return free

    def state_valid(self, state: Any) -> bool:
        """Whether one state is free."""
        return not self._deadline.passed and self._checker.valid(np.array(state[0 : self._n]))


def problem(
    chain: Chain, checker: Checker, start: Array, goals: list[Array], deadline: Deadline
) -> tuple[Any, Any, CertifiedEdges]:
    """OMPL's space information and problem definition, and the edges that it will ask for."""
    space = joint_space(chain, [start, *goals])
    information = base.SpaceInformation(space)
    edges = CertifiedEdges(information, checker, chain.n, deadline)
    information.setStateValidityChecker(edges.state_valid)
    information.setMotionValidator(edges)
    information.setup()
    definition = base.ProblemDefinition(information)
    definition.addStartState(state_of(space, start))
    targets = base.GoalStates(information)
    for goal in goals:
        targets.addState(state_of(space, goal))
    definition.setGoal(targets)
    definition.setOptimizationObjective(base.PathLengthOptimizationObjective(information))
    return information, definition, edges


def solution(definition: Any, n: int) -> Array | None:
    """The path that was found, shape (k, n), if it ends at a goal."""
    # The status is also true of paths that end near the goal: only an exact one counts.
    if not definition.hasExactSolution():
        return None
    states = definition.getSolutionPath().getStates()
    return np.array([state[0:n] for state in states], dtype=np.float64)


#: Memory that a planner may fill before it is stopped [bytes].
MAX_MEMORY = 1 << 30
#: Where Linux says how many pages a process has.
_STATM = Path("/proc/self/statm")


def resident() -> int:
    """Memory of this process [bytes]; 0 where that can't be told."""
    try:
        # Size of a page of memory [bytes].
        return 4096 * int(_STATM.read_text().split()[1])
    except (OSError, ValueError, IndexError):
        return 0


@dataclass(slots=True)
class Watch:
    """Asked by a planner, again and again, whether to stop.

    Args:
        deadline: Instant at which time is up.
        edges: Number of edges that were checked so far.
        max_iterations: Questions after which to stop.
        max_edges: Edges after which to stop.
        share: Edges after which another run is to be begun, if there is no path yet.
        turn: Questions after which that is so too.
        threshold: Length of a path that is short enough.
        best: Length of the shortest path so far, of a planner that improves its own.
    """

    deadline: Deadline
    edges: Callable[[], int]
    max_iterations: int | None = None
    max_edges: int | None = None
    share: float = math.inf
    turn: float = math.inf
    threshold: float | None = None
    best: Callable[[], float] | None = None
    iterations: int = 0
    reason: str | None = None
    progress: list[Progress] = field(default_factory=list)
    began: float = field(default_factory=time.monotonic)
    memory: int = field(default_factory=resident)

    def __call__(self) -> bool:
        """Whether to stop; why is kept as ``reason``."""
        if self.reason is not None:
            return True
        self.iterations += 1
        if self.best is not None:
            self.note(self.best())
        if self.reason is None:
            self.reason = self._over_budget()
        return self.reason is not None

    def note(self, length: float) -> None:
        """Keep the length of a path, if it is the shortest so far."""
        if not (math.isfinite(length) and length > 0.0):
            return
        # Share of its length by which a path has to be shorter to count as progress.
        if self.progress and length >= (1.0 - 1e-6) * self.progress[-1].length:
            return
        spent = 1e3 * (time.monotonic() - self.began)
        self.progress.append(Progress(spent, self.edges(), length))
        if self.threshold is not None and length <= self.threshold:
            self.reason = "threshold"

    def _over_budget(self) -> str | None:
        if self.deadline.passed:
            return "time"
        if self.max_iterations is not None and self.iterations >= self.max_iterations:
            return "iterations"
        if self.max_edges is not None and self.edges() >= self.max_edges:
            return "edges"
        if not self.progress and (self.edges() >= self.share or self.iterations >= self.turn):
            return "share"
        # Questions between two looks at the memory: one costs as much as a few edges.
        full = self.iterations % 512 == 0 and resident() - self.memory > MAX_MEMORY
        if full:
            self.deadline.interruptions.occurred = True
            return "memory"
        return None


class Roadmap:
    """Proved edges as a graph.

    Args:
        start: Configuration, shape (n,) [rad or m].
        goals: Configurations, shape (n,) each.
    """

    def __init__(self, start: Array, goals: list[Array]) -> None:
        self._number: dict[bytes, int] = {}
        self._states: list[Array] = []
        self._ends: list[tuple[int, int]] = []
        self._lengths: list[float] = []
        self._known: set[tuple[int, int]] = set()
        self._start = self._vertex(start)
        self._goals = [self._vertex(goal) for goal in goals]

    def add(self, a: Array, b: Array) -> None:
        """Keep an edge between configurations a and b, both (n,), once."""
        ends = (self._vertex(a), self._vertex(b))
        if ends[0] == ends[1] or ends in self._known:
            return
        self._known |= {ends, ends[::-1]}
        self._ends.append(ends)
        self._lengths.append(float(np.linalg.norm(b - a)))

    def shortest(self) -> Array | None:
        """The shortest path from the start to any goal, shape (k, n), if there is one."""
        if not self._ends:
            return None
        rows, columns = np.array(self._ends).T
        size = len(self._states)
        graph: Any = scipy.sparse.coo_array(
            (self._lengths, (rows, columns)), shape=(size, size)
        ).tocsr()
        tree = scipy.sparse.csgraph.dijkstra(
            graph, directed=False, indices=np.array([self._start]), return_predecessors=True
        )
        far, before = tree[0][0], tree[1][0]
        goal = min(self._goals, key=lambda g: far[g])
        if not np.isfinite(far[goal]):
            return None
        path = [goal]
        while path[-1] != self._start:
            path.append(int(before[path[-1]]))
        return np.array([self._states[v] for v in reversed(path)])

    def _vertex(self, q: Array) -> int:
        key = q.tobytes()
        if key not in self._number:
            self._number[key] = len(self._states)
            self._states.append(q)
        return self._number[key]


def grow_roadmap(
    solver: Any, edges: CertifiedEdges, start: Array, goals: list[Array], watch: Watch, *, on: bool
) -> Array | None:
    """Grow a roadmap until it connects start and goal, or go ``on`` as long as there is time.

    Returns:
        The shortest path, shape (k, n), if there is one.
    """
    edges.proved = []
    roadmap = Roadmap(start, goals)
    # Told to stop at once, OMPL takes in the start and one more goal each time and does no more.
    for _ in goals:
        solver.solve(base.plannerAlwaysTerminatingCondition())
    best = None
    # Edges at which the roadmap is searched first; then whenever it has grown by a fifth.
    search_at = 8

    def pause() -> bool:
        return watch() or edges.count >= search_at

    while True:
        for a, b in edges.proved:
            roadmap.add(a, b)
        edges.proved.clear()
        path = roadmap.shortest()
        if path is not None:
            best = path
            watch.note(float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()))
            if not on:
                watch.reason = watch.reason or "solved"
        if watch.reason is not None:
            return best
        search_at = int(1.2 * max(search_at, edges.count)) + 1
        solver.growRoadmapPtc(base.PlannerTerminationCondition(pause))


#: The time a random tree takes is spread widely: one that has looked at so many edges without
#: arriving is given up for a fresh one, which may check somewhat more. Counted in edges, not in
#: time, the answer depends on the seed alone.
_FIRST_BUDGET = 2000

_NOT_REPEATED = (
    "The planner looked for shorter paths until it had to stop: the same request may find another "
    "one. With max_iterations, max_edges or cost_threshold among planner_options it repeats."
)
_STOPPED = {
    "time": "the time was up",
    "iterations": "max_iterations were used up",
    "edges": "max_edges were used up",
    "threshold": "the path was short enough",
    "memory": "the memory that one plan may take was used up",
}


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """A request, for every run of its planner."""

    name: str
    planner: Planner
    chain: Chain
    checker: Checker
    start: Array
    goals: list[Array]
    options: Mapping[str, Value]
    deadline: Deadline
    explored: Explored | None = None


@dataclass(slots=True)
class _Account:
    """Edges, iterations and runs that a request has spent."""

    edges: int = 0
    iterations: int = 0
    runs: int = 0


def sample(
    planner: str,
    chain: Chain,
    checker: Checker,
    start: Array,
    goals: list[Array],
    options: Mapping[str, Any],
    seed: int,
    deadline: Deadline,
) -> Attempt:
    """Plan from a configuration to any of several with one of OMPL's planners.

    Args:
        planner: One of ``PLANNERS``.
        chain: The robot, for its limits.
        checker: The robot in its scene.
        start: Shape (n,), valid.
        goals: Valid configurations (n,).
        options: Options by name; ``planners`` lists them.
        seed: Seed: the same one gives the same path, unless time ends the search for shorter ones.
        deadline: Instant at which the search stops.

    Raises:
        InvalidOption: An unknown planner or option, or a value out of its range.
    """
    values = complete_options(planner, options)
    return _answer(
        _Search(planner, planner_by_name(planner), chain, checker, start, goals, values, deadline),
        seed,
    )


def _answer(search: _Search, seed: int) -> Attempt:
    """Run the planner until it has a path, or has to stop."""
    start = search.start
    for goal in search.goals:
        if np.array_equal(start, goal):
            return Attempt(np.array([start, goal]), "The start is a goal.")
    spent = _Account()
    while True:
        # OMPL's generator is one for the process: what is drawn from here on depends on this alone.
        # The trees of one request are far apart in seeds: neighbouring requests should not share
        # them. OMPL's generator takes 2^31 - 1.
        util.RNG.setSeed((seed + spent.runs * 7_919) % (2**31 - 1) + 1)
        waypoints, watch = _run(search, spent)
        if waypoints is not None or watch.reason not in (None, "share") or search.deadline.passed:
            return _attempt(search, waypoints, watch, spent)


@dataclass(frozen=True, slots=True, eq=False)
class OmplPlanner:
    """One of OMPL's planners.

    Args:
        name: One of ``PLANNERS``.
        options: Options by name; ``planners`` lists them.
    """

    name: str
    options: Mapping[str, Any]
    needs_goals: ClassVar[bool] = True

    @classmethod
    def of(cls, name: str, options: Mapping[str, Any]) -> "OmplPlanner":
        """Return the planner with these options, checked.

        Raises:
            InvalidOption: An unknown planner or option, or a value out of its range.
        """
        complete_options(name, options)
        return cls(name, options)

    def plan(self, query: Query) -> Attempt:
        """Plan from the start to any of the goals."""
        options = complete_options(self.name, self.options)
        if query.bound is not None:
            own = options["max_edges"]
            options = {**options, "max_edges": min(query.bound, int(own or query.bound))}
        search = _Search(
            self.name,
            planner_by_name(self.name),
            query.problem.robot.chain,
            query.checker,
            query.ready.start,
            query.ready.goals,
            options,
            query.deadline,
            query.explored,
        )
        return _answer(search, query.seed)


def _run(search: _Search, spent: _Account) -> tuple[Array | None, Watch]:
    """One run of the planner: the path it found, and when and why it stopped."""
    planner, goals = search.planner, search.goals
    if planner.one_goal:
        goals = [goals[spent.runs % len(goals)]]
        if planner.improves and search.checker.free(search.start, goals[0]):
            # AORRTC 2.0 answers the goal alone where nothing stands between it and the start
            # (OMPL's issue 1420). Nothing is shorter than the straight way.
            spent.edges += 1
            spent.runs += 1
            return np.array([search.start, goals[0]]), Watch(search.deadline, edges=lambda: 1)
    information, definition, edges = problem(
        search.chain, search.checker, search.start, goals, search.deadline
    )
    if search.explored is not None:
        search.explored.begin(search.name)
        edges.explored = search.explored
    watch = _watch(search, spent, edges)
    solver = getattr(geometric, planner.ompl)(information)
    # Before anything else: some of OMPL's planners can't even be thrown away without a problem.
    solver.setProblemDefinition(definition)
    for name, value in _settings(search, spent.runs):
        planner.options[name].setter(solver)(value)
    solver.setup()
    if planner.roadmap:
        path = grow_roadmap(solver, edges, search.start, goals, watch, on=planner.improves)
    else:
        if planner.improves:
            watch.best = lambda: float(solver.bestCost().value())
        solver.solve(base.PlannerTerminationCondition(watch))
        watch.best = None
        path = solution(definition, search.chain.n)
    spent.edges += edges.count
    spent.iterations += watch.iterations
    spent.runs += 1
    return path, watch


def _settings(search: _Search, runs: int) -> list[tuple[str, Value]]:
    """The planner's own options that are set, with their values."""
    own = {
        parameter.name: search.options[parameter.name] for parameter in search.planner.parameters
    }
    batch = search.planner.batch
    if batch is not None:
        first = own[batch]
        assert isinstance(first, int)
        rounds = runs // len(search.goals) if search.planner.one_goal else runs
        # A batch of states that left start and goal apart is followed by one of twice as many, up
        # to a largest one.
        own[batch] = min(first * 2**rounds, max(20_000, first))
    return [(name, value) for name, value in own.items() if value is not None]


def _watch(search: _Search, spent: _Account, edges: CertifiedEdges) -> Watch:
    """Stops a run at what is left of the request's budgets, or at the run's own share."""
    options, planner = search.options, search.planner
    threshold = options.get("cost_threshold")
    watch = Watch(
        search.deadline,
        edges=lambda: edges.count,
        threshold=None if threshold is None else float(threshold),
        max_iterations=_remaining_budget(options["max_iterations"], spent.iterations),
        max_edges=_remaining_budget(options["max_edges"], spent.edges),
    )
    # Factor by which the next tree may check more.
    share = _FIRST_BUDGET * 1.1**spent.runs
    if planner.one_goal and len(search.goals) > 1:
        # Every goal has its turn before the budgets are spent.
        turns = 2 * len(search.goals)
        watch.share = min(share, _budget(options["max_edges"]) / turns)
        # Questions for each edge of its share after which a run that hardly looks at edges is ended
        # too.
        watch.turn = min(20 * share, _budget(options["max_iterations"]) / turns)
    elif not (planner.improves or planner.roadmap or planner.batch):
        watch.share = share
    return watch


def _budget(value: Value) -> float:
    return math.inf if value is None else float(value)


def _remaining_budget(budget: Value, spent: int) -> int | None:
    return None if budget is None else max(int(budget) - spent, 1)


def _attempt(search: _Search, waypoints: Array | None, watch: Watch, spent: _Account) -> Attempt:
    """Attempt from the runs' results; its path is proved once more."""
    runs = "" if spent.runs == 1 else f" in {spent.runs} runs"
    detail = f"{spent.edges} edges checked{runs}"
    if waypoints is not None and not _joins(waypoints, search):
        return Attempt(None, f"{detail}; the planner's path does not lead from start to goal.")
    if waypoints is not None and not search.checker.polyline(waypoints)[0].free:
        return Attempt(None, f"{detail}; the planner joined states that no proved edge joins.")
    if watch.progress:
        first, last = watch.progress[0], watch.progress[-1]
        detail += (
            f"; the first path of length {first.length:.4g} after {first.milliseconds:.0f} ms, the "
            f"shortest of {last.length:.4g} after {last.milliseconds:.0f} ms"
        )
    if watch.reason in _STOPPED:
        detail += f"; {_STOPPED[watch.reason]}"
    notes: tuple[str, ...] = ()
    if waypoints is not None and watch.reason in ("time", "memory"):
        notes = (_NOT_REPEATED,)
    return Attempt(waypoints, f"{detail}.", notes, progress=tuple(watch.progress))


def _joins(waypoints: Array, search: _Search) -> bool:
    last = waypoints[-1]
    return np.array_equal(waypoints[0], search.start) and any(
        np.array_equal(last, goal) for goal in search.goals
    )
