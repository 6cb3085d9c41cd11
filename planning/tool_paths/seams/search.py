"""The search for a joint path along a seam: layers of configurations, then places in between.

The cheapest way through the layers is searched for first, without a check of collisions. Its
configurations and the places between them are then checked: what collides, or has no continuous way
to the next layer, is taken out, and the search goes on.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from kinematics.model.chain import Chain, JointType
from obstacles.collision.checker import Checker
from planning.tool_paths.projection import REACHED, project
from planning.tool_paths.seams.nodes import COARSE, DENSE, TWO_TURNS, Density, Nodes, nodes
from planning.tool_paths.seams.path import SeamPlaces
from planning.values.deadline import Deadline

#: Largest motion of a joint between neighbouring layers [rad or m].
_LAYER_JUMP = 0.9
#: Largest motion of a joint between neighbouring places [rad or m].
_JUMP = 0.45
_FULL_TURN = 2.0 * np.pi


class Layers(NamedTuple):
    """Layers of configurations.

    Args:
        joints: All configurations, layer by layer, shape (m, n).
        firsts: Index of the first of each layer, and m, shape (l + 1,).
        costs: Costs of each configuration, infinite where it is not to be used, shape (m,).
        times: Least time from each layer to the next, shape (l - 1,) [s].
    """

    joints: Array
    firsts: Indices
    costs: Array
    times: Array


class Steps(NamedTuple):
    """Motions that are allowed from layer to layer.

    Args:
        weights: Least time of a joint for a unit of motion, shape (n,) [s/rad or s/m].
        turns: 1 for joints whose whole turns do not count, shape (n,).
        jump: Largest motion of a joint between neighbouring layers [rad or m].
        blocked: Pairs of configurations that have no way between them, shape (b, 2).
    """

    weights: Array
    turns: Indices
    jump: float
    blocked: Indices


class Ways(NamedTuple):
    """Cheapest ways to configurations.

    Args:
        best: Cost of the best way to each configuration, shape (m,).
        before: The configuration before on that way, -1 where it begins, shape (m,).
        origin: The layer where it begins, shape (m,).
    """

    best: Array
    before: Indices
    origin: Indices


@kernel
def layer_kernel(layers: Layers, steps: Steps, ways: Ways) -> None:
    """Cheapest ways through layers of configurations, by dynamic programming.

    A way costs, between neighbouring layers, the longest time that a joint or the tool takes and a
    share of the squared motion; where a layer can't be reached ways begin anew.

    Args:
        layers: The configurations.
        steps: Motions that are allowed between them.
        ways: Written.
    """
    joints, firsts, costs, times = layers
    weights, turns, jump, blocked = steps
    best, before, origin = ways
    n = joints.shape[1]
    two_pi = 2.0 * math.pi
    for layer in range(firsts.shape[0] - 1):
        for j in range(firsts[layer], firsts[layer + 1]):
            best[j], before[j], origin[j] = costs[j], -1, layer
            if layer == 0 or not costs[j] < np.inf:
                continue
            cheapest, start = np.inf, layer
            for i in range(firsts[layer - 1], firsts[layer]):
                if not best[i] < np.inf or origin[i] > start:
                    continue
                longest, square, fits = times[layer - 1], 0.0, True
                for k in range(n):
                    step = joints[j, k] - joints[i, k]
                    if turns[k] == 1:
                        step -= two_pi * math.floor(step / two_pi + 0.5)
                    if abs(step) > jump:
                        fits = False
                        break
                    time = abs(step) * weights[k]
                    longest = max(longest, time)
                    square += time * time
                if not fits:
                    continue
                # Weight of the squared joint motion beside the time, so that of equal times the
                # calmest is taken.
                cost = best[i] + longest + 0.2 * square / max(times[layer - 1], 1e-3)
                # A way that begins earlier is better, whatever it costs.
                if origin[i] == start and cost >= cheapest:
                    continue
                for b in range(blocked.shape[0]):
                    if blocked[b, 0] == i and blocked[b, 1] == j:
                        fits = False
                if fits:
                    cheapest, start = cost, origin[i]
                    before[j], origin[j] = i, origin[i]
            if before[j] >= 0:
                best[j] = costs[j] + cheapest


@dataclass(slots=True)
class SeamGraph:
    """Layers of configurations along a seam, with what is known of them.

    Args:
        layers: Index of the place of each layer.
        nodes: Configurations, layer by layer.
        costs: Costs of each, infinite where it collides.
        best: Cost of the cheapest way to each.
        before: Configuration before on that way, -1 where it begins.
        origin: Layer where it begins.
        collided: Target of each configuration whether it collides.
        blocked: Pairs of configurations that have no continuous way between them.
        hits: Pairs among these between which there is a collision, with a configuration in it.
        winds: Whether whole turns of joints with two of them do not count.
        jump: Largest motion of a joint from one layer to the next [rad or m].
    """

    layers: NDArray[np.int64]
    nodes: Nodes
    costs: Array
    best: Array
    before: NDArray[np.int64]
    origin: NDArray[np.int64]
    collided: NDArray[np.bool_]
    blocked: list[tuple[int, int]] = field(default_factory=list)
    hits: dict[tuple[int, int], Array] = field(default_factory=dict)
    winds: bool = True
    jump: float = _LAYER_JUMP

    def of_layer(self, layer: int) -> NDArray[np.int64]:
        """Numbers of the configurations of a layer."""
        return np.arange(self.nodes.firsts[layer], self.nodes.firsts[layer + 1])

    def reached(self, layer: int) -> NDArray[np.int64]:
        """Numbers of those of a layer that ways from the first layer lead to."""
        mine = self.of_layer(layer)
        return np.asarray(mine[np.isfinite(self.best[mine]) & (self.origin[mine] == 0)])

    def cheapest(self, layer: int) -> list[int] | None:
        """The cheapest way from the first layer to another one; None where there is none."""
        reached = self.reached(layer)
        if not reached.size:
            return None
        way = [int(reached[np.argmin(self.best[reached])])]
        while self.before[way[-1]] >= 0:
            way.append(int(self.before[way[-1]]))
        return way[::-1]

    def block(self, way: Sequence[int], place: int) -> tuple[int, int]:
        """Close the step of a way that leads over a place, and return it."""
        layer = min(max(int(np.searchsorted(self.layers, place)), 1), len(way) - 1)
        self.blocked.append((way[layer - 1], way[layer]))
        return self.blocked[-1]

    def longest(self) -> tuple[int, int]:
        """The layers that the longest way begins and ends at."""
        candidates = np.flatnonzero(np.isfinite(self.best))
        if not candidates.size:
            return 0, 0
        layer = np.searchsorted(self.nodes.firsts, candidates, side="right") - 1
        size = layer - self.origin[candidates]
        k = int(np.argmax(size))
        return int(self.origin[candidates[k]]), int(layer[k])


class SeamJoints(NamedTuple):
    """Configurations at the places of a seam, or the graph in which there are none.

    Args:
        joints: Shape (k, n); None where there is no way.
        graph: The layers that were searched.
    """

    joints: Array | None
    graph: SeamGraph


@dataclass(frozen=True, slots=True, eq=False)
class SeamSearch:
    """The search for the joints along one seam.

    Args:
        checker: The robot in its scene.
        places: Places of the seam.
        start: Configuration before the seam, shape (n,).
        tool_speeds: Speed on the way to each waypoint but the first [m/s]; empty for none.
        deadline: Time at which to stop.
        first: Configurations that the seam may begin at, shape (k, n); None for any.
    """

    checker: Checker
    places: SeamPlaces
    start: Array
    tool_speeds: tuple[float, ...]
    deadline: Deadline
    first: Array | None = None

    @property
    def chain(self) -> Chain:
        """The robot; its tip is the tool."""
        return self.checker.model.robot.chain

    def run(self, every: bool = False, density: Density = COARSE) -> SeamJoints:
        """Search for the cheapest way that is continuous and free at all places.

        Args:
            every: Whether all places are layers.
            density: Density of the configurations that are checked.
        """
        graph = self.prepare(self.places.layers(every), density)
        graph.jump = _JUMP if every else _LAYER_JUMP
        return self._go_on(graph)

    def around(self, found: SeamJoints, share: float) -> SeamJoints:
        """Search for another way than the one found, which is closed at a share of the length."""
        way = found.graph.cheapest(len(found.graph.layers) - 1)
        assert way is not None
        place = int(np.searchsorted(self.places.along, share * self.places.length))
        found.graph.block(way, place)
        return self._go_on(found.graph)

    def _go_on(self, graph: SeamGraph) -> SeamJoints:
        """The cheapest way through layers that is continuous and free at all places."""
        # Ways through the layers that are tried.
        for tries in range(1, 201):
            self.solve(graph)
            way = graph.cheapest(len(graph.layers) - 1)
            if way is None or self.deadline.passed:
                break
            # After so many of them all configurations are checked for collisions at once.
            if tries == 6:
                self.check_all(graph)
            elif self._is_free(graph, way):
                joints = self._fill(graph, way)
                if joints is not None:
                    return SeamJoints(joints, graph)
        return SeamJoints(None, graph)

    def prepare(self, layers: NDArray[np.int64], density: Density = COARSE) -> SeamGraph:
        """Layers with their configurations and costs."""
        chain = self.chain
        found = nodes(chain, self.places, layers, self.start, density)
        if density is DENSE:
            found = self._with_neighbours(layers, found, density.most)
        if self.first is not None:
            found = found.begun_at(self.first)
        joints, firsts = found.joints, found.firsts
        lower, upper = _narrow(chain)
        half = 0.5 * (upper - lower)
        with np.errstate(invalid="ignore", divide="ignore"):
            left = np.minimum(joints - lower, upper - joints) / half
        # Share of a joint's range from its limit at which that costs nothing.
        near = np.clip(1.0 - np.where(np.isfinite(left), left, 1.0) / 0.1, 0.0, 1.0)
        # Cost of a configuration at a joint limit.
        costs = 0.3 * (near**2).sum(axis=1)
        costs[((joints < lower) | (joints > upper)).any(axis=1)] = np.inf
        first = slice(0, firsts[1])
        away = np.abs(joints[first] - self.start) * self._weights()
        if len(away):
            # Weight of the motion from the start to a seam's first configuration.
            costs[first] += 0.5 * away.max(axis=1)
        m = len(joints)
        empty = np.zeros(m, dtype=np.int64)
        return SeamGraph(
            layers, found, costs, np.full(m, np.inf), empty - 1, empty.copy(), empty != 0
        )

    def beginnings(self, density: Density) -> Array:
        """Configurations at the first place near to those at the second one, shape (k, n).

        Where an arm is singular, inverse kinematics answers few of the many that it can begin in.
        """
        joints = nodes(self.chain, self.places, np.array([1]), self.start, density).joints
        first = np.zeros(len(joints), dtype=np.int64)
        errors = self.project_at(joints, first, np.array(_narrow(self.chain)))
        return np.asarray(joints[errors.max(axis=1, initial=0.0) <= REACHED])

    def _with_neighbours(self, layers: NDArray[np.int64], found: Nodes, most: int) -> Nodes:
        """Configurations, where a layer has none those of the layers beside it moved there.

        At the end of an arm's reach samples miss the few deviations that are left.
        """
        if np.diff(found.firsts).all():
            return found
        rows, limits = np.split(found.joints, found.firsts[1:-1]), np.array(_narrow(self.chain))
        for way in (1, -1):
            for k in range(len(rows))[::way]:
                beside = k - way
                if len(rows[k]) or not 0 <= beside < len(rows) or not len(rows[beside]):
                    continue
                moved = rows[beside][:most].copy()
                errors = self.project_at(moved, np.full(len(moved), layers[k]), limits)
                rows[k] = moved[errors.max(axis=1) <= REACHED]
        return Nodes.of(rows)

    def solve(self, graph: SeamGraph) -> None:
        """Find the cheapest way to each configuration."""
        along = self.places.along[graph.layers]
        # Speed that layers are weighed by where none is asked for [m/s].
        speeds = np.array(self.tool_speeds or (0.5,))
        ways = np.minimum(self.places.waypoint[graph.layers[:-1]], len(speeds) - 1)
        times = np.diff(along) / speeds[ways]
        blocked = np.array(graph.blocked, dtype=np.int64).reshape(-1, 2)
        layer_kernel(
            Layers(graph.nodes.joints, graph.nodes.firsts, graph.costs, times),
            Steps(self._weights(), self._turns() * int(graph.winds), graph.jump, blocked),
            Ways(graph.best, graph.before, graph.origin),
        )

    def without_collisions(self, graph: SeamGraph) -> SeamGraph:
        """Layers with the ways that there would be if nothing was in the way."""
        free = replace(
            graph,
            costs=np.where(graph.collided, 0.0, graph.costs),
            best=graph.best.copy(),
            before=graph.before.copy(),
            origin=graph.origin.copy(),
            blocked=[step for step in graph.blocked if step not in graph.hits],
        )
        self.solve(free)
        return free

    def check_all(self, graph: SeamGraph) -> None:
        """Check all configurations that are left for collisions."""
        for node in np.flatnonzero(np.isfinite(graph.costs)):
            if self.deadline.passed:
                return
            self._check(graph, int(node))

    def _is_free(self, graph: SeamGraph, way: Sequence[int]) -> bool:
        """Whether no configuration of a way collides; those that do are taken out."""
        free = [self._check(graph, node) for node in way]
        return all(free)

    def _check(self, graph: SeamGraph, node: int) -> bool:
        if graph.collided[node]:
            return False
        if self.checker.valid(graph.nodes.joints[node]):
            return True
        graph.collided[node], graph.costs[node] = True, np.inf
        return False

    def _fill(self, graph: SeamGraph, way: Sequence[int]) -> Array | None:
        """Configurations at all places; None, and a pair blocked, where there is no way on."""
        corners = graph.nodes.joints[list(way)]
        if graph.winds:
            unwound = self._unwind(corners)
            if unwound is None:
                graph.winds = False
                return None
            corners = unwound
        k = np.arange(len(self.places.s))
        joints = np.column_stack(
            [np.interp(k, graph.layers, corners[:, j]) for j in range(self.chain.n)]
        )
        errors = self.project(joints)
        wrong = errors.max(axis=1) > REACHED
        wrong[1:] |= (np.abs(np.diff(joints, axis=0)) > _JUMP).any(axis=1)
        place, hit = int(np.argmax(wrong)) if wrong.any() else -1, None
        if place < 0:
            colliding = (i for i, q in enumerate(joints) if not self.checker.valid(q))
            place = next(colliding, -1)
            if place < 0:
                return joints
            hit = joints[place]
        step = graph.block(way, place)
        if hit is not None:
            graph.hits[step] = hit
        return None

    def project(self, joints: Array, away_from_limits: float = 0.0) -> Array:
        """Move configurations (k, n) into the tolerances; what is left [m], [rad], shape (k, 2).

        Args:
            joints: Moved.
            away_from_limits: Part of half of a joint's range that is kept free at either end; of a
                joint that is nearer already, what it keeps free.
        """
        lower, upper = _narrow(self.chain)
        if away_from_limits > 0.0:
            half = 0.5 * (upper - lower)
            room = np.where(np.isfinite(half), away_from_limits * half, 0.0)
            lower = np.maximum(lower, np.minimum(lower + room, joints.min(axis=0)))
            upper = np.minimum(upper, np.maximum(upper - room, joints.max(axis=0)))
        return self.project_at(joints, np.arange(len(joints)), np.array([lower, upper]))

    def project_at(self, joints: Array, places: NDArray[np.int64], limits: Array) -> Array:
        """Move configurations (k, n) into the tolerances at places (k,), within limits (2, n)."""
        nominal, boxes = self.places.nominal[places], self.places.boxes[places]
        return project(self.chain, nominal, boxes, limits, joints)

    def _unwind(self, corners: Array) -> Array | None:
        """A way without jumps by whole turns, inside the limits; None where there is none."""
        turns = self._turns() == 1
        if not turns.any():
            return corners
        lower, upper = _narrow(self.chain)
        way = corners.copy()
        way[:, turns] = np.unwrap(way[:, turns], axis=0)
        for j in np.flatnonzero(turns):
            low, high = float(way[:, j].min()), float(way[:, j].max())
            # The whole turn that brings it inside, nearest to where it is.
            least = np.ceil((lower[j] - low) / _FULL_TURN - 1e-9)
            most = np.floor((upper[j] - high) / _FULL_TURN + 1e-9)
            if least > most:
                return None
            near = np.round((self.start[j] - way[0, j]) / _FULL_TURN)
            way[:, j] += _FULL_TURN * min(max(near, least), most)
        return way

    def _weights(self) -> Array:
        """Least time of each joint for a unit of motion."""
        velocity = self.chain.limits.velocity
        known = np.isfinite(velocity) & (velocity > 0.0)
        # Speed of a joint whose limit is not known [rad/s or m/s].
        return np.asarray(1.0 / np.where(known, velocity, 2.0))

    def _turns(self) -> NDArray[np.int64]:
        """1 for revolute joints whose range is nearly two whole turns or more."""
        wide = self.chain.limits.upper - self.chain.limits.lower >= TWO_TURNS
        return np.asarray(wide & (self.chain.joint_types == JointType.REVOLUTE), dtype=np.int64)


def _narrow(chain: Chain) -> tuple[Array, Array]:
    """Joint limits with a little kept for the spline between places."""
    # Distance to the joint limits that is kept, for the spline between the places [rad or m].
    inset = 2e-3
    return chain.limits.lower + inset, chain.limits.upper - inset
