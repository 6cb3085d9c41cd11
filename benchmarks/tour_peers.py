"""Peers of tours, in an interpreter of their own: ``python tour_peers.py case.npz SECONDS peer``.

It needs numpy and whichever peers are there; those that are not are left out and said so. The case
holds one table of times between configurations; the last one is the start, where the tour ends too.

- ``fast_tsp``: order by fast-tsp among one configuration a goal, then the configurations by dynamic
  programming over the layers of that order, in turns, from many first choices, as RoboTSP does.
- ``or_tools``: one node a configuration, one disjunction a goal, guided local search.
"""

import sys
import time
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
#: fast-tsp takes whole numbers of 16 bits.
_LARGEST = 65_000
#: OR-Tools takes whole numbers: microseconds.
_MICRO = 1e6


def choose_layers(times: Array, first: Array, order: list[int]) -> tuple[float, Array]:
    """Least time of a round trip in an order of goals, and the configuration of each goal.

    Args:
        times: Shape (m, m) [s]; the last configuration is the start.
        first: First configuration of each goal, and their number, shape (g + 1,).
        order: Numbers of the goals.
    """
    depot = len(times) - 1
    rows = np.array([depot])
    value, sources = np.zeros(1), []
    for goal in order:
        following = np.arange(first[goal], first[goal + 1])
        total = value[:, None] + times[np.ix_(rows, following)]
        sources.append(rows[total.argmin(axis=0)])
        value, rows = total.min(axis=0), following
    total = value + times[rows, depot]
    choice = np.empty(len(order), dtype=np.int64)
    chosen = rows[int(total.argmin())]
    for k in range(len(order) - 1, -1, -1):
        choice[order[k]] = chosen
        chosen = sources[k][chosen - first[order[k]]]
    return float(total.min()), choice


def fast_tsp(times: Array, first: Array, seconds: float) -> tuple[list[int], Array]:
    """Order and configurations by turns of fast-tsp and dynamic programming."""
    solver = import_module("fast_tsp")
    end, goals = time.perf_counter() + seconds, len(first) - 1
    random = np.random.default_rng(0)
    best: tuple[float, list[int], Array] = (np.inf, [], np.empty(0, np.int64))
    choice = None
    while time.perf_counter() < end:
        last = np.inf
        while time.perf_counter() < end:
            if choice is None:
                rows = np.minimum.reduceat(times, [*first[:-1], len(times) - 1], axis=0)
                table = np.minimum.reduceat(rows, [*first[:-1], len(times) - 1], axis=1)
            else:
                picked = [*choice, len(times) - 1]
                table = times[np.ix_(picked, picked)]
            whole = np.rint(table * (_LARGEST / table.max())).astype(int)
            np.fill_diagonal(whole, 0)
            left = max(end - time.perf_counter(), 0.05)
            tour = solver.find_tour(whole.tolist(), min(1.0, left), stop_when_converged=True)
            at = tour.index(goals)
            order = tour[at + 1 :] + tour[:at]
            length, choice = choose_layers(times, first, order)
            if length < best[0]:
                best = (length, order, choice)
            if length >= last - 1e-9:
                break
            last = length
        swapped = random.random(goals) < 0.2
        choice = np.where(swapped, random.integers(first[:-1], first[1:]), best[2])
    return best[1], best[2]


def or_tools(times: Array, first: Array, seconds: float) -> tuple[list[int], Array]:
    """Order and configurations by the routing solver of OR-Tools."""
    routing = import_module("ortools.constraint_solver.pywrapcp")
    enums = import_module("ortools.constraint_solver.routing_enums_pb2")
    begin = time.perf_counter()
    goals, m = len(first) - 1, len(times)
    manager = routing.RoutingIndexManager(m, 1, m - 1)
    model = routing.RoutingModel(manager)
    whole = np.rint(times * _MICRO).astype(np.int64).tolist()
    model.SetArcCostEvaluatorOfAllVehicles(model.RegisterTransitMatrix(whole))
    for goal in range(goals):
        nodes = [manager.NodeToIndex(int(k)) for k in range(first[goal], first[goal + 1])]
        model.AddDisjunction(nodes, int(1e4 * _MICRO), 1)
    parameters = routing.DefaultRoutingSearchParameters()
    parameters.first_solution_strategy = enums.FirstSolutionStrategy.PATH_CHEAPEST_ARC
    parameters.local_search_metaheuristic = enums.LocalSearchMetaheuristic.GUIDED_LOCAL_SEARCH
    left = max(seconds - (time.perf_counter() - begin), 0.1)
    parameters.time_limit.FromMilliseconds(int(1e3 * left))
    answer = model.SolveWithParameters(parameters)
    if answer is None:
        return [], np.empty(0, np.int64)
    order, choice = [], np.zeros(goals, dtype=np.int64)
    index = answer.Value(model.NextVar(model.Start(0)))
    while not model.IsEnd(index):
        node = manager.IndexToNode(index)
        goal = int(np.searchsorted(first, node, "right")) - 1
        order.append(goal)
        choice[goal] = node
        index = answer.Value(model.NextVar(index))
    return order, choose_layers(times, first, order)[1] if len(order) == goals else choice


PEERS = {"fast_tsp": fast_tsp, "or_tools": or_tools}


def main() -> None:
    """Answer a case."""
    path, seconds, names = sys.argv[1], float(sys.argv[2]), sys.argv[3:]
    case, answers = np.load(path), {}
    for name in names:
        if name not in PEERS:
            print(f"{name}: there is no such peer")
            continue
        try:
            order, choice = PEERS[name](case["times"].astype(float), case["first"], seconds)
        except ModuleNotFoundError as missing:
            print(f"{name}: {missing.name} is not installed")
            continue
        answers[f"{name}_order"], answers[f"{name}_choice"] = np.array(order), choice
    np.savez(path.replace(".npz", ".answers.npz"), allow_pickle=False, **answers)


if __name__ == "__main__":
    main()
