"""Configurations of places on a seam: branches of inverse kinematics at sampled deviations."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.ik.closed_form.analytic import branches, middle, parameter
from kinematics.ik.closed_form.structure import structure
from kinematics.ik.numeric import numeric
from kinematics.model.chain import Chain, JointType, Limits
from kinematics.pose import from_axis_angle, inverse, transform
from planning.tool_motions.tool_tolerance import RX, RY, SIZE, ToolTolerance, tilts
from planning.tool_paths.seams.path import SeamPlaces

#: Angle between neighbouring samples of a rotation [rad].
_ANGLE = math.radians(15.0)
_FULL_TURN = 2.0 * math.pi
#: Range of a joint from which on its turns are chosen at the end of the search [rad].
TWO_TURNS = 4.0 * math.pi - 1.0


class Density(NamedTuple):
    """Density of the configurations that are checked.

    Args:
        most: Configurations of one place at most.
        parameters: Values of a redundant arm's parameter.
        carried: Values of that of an arm that is carried.
    """

    most: int
    parameters: int
    carried: int


#: Few configurations, for the first look.
COARSE = Density(250, 12, 5)
#: More of them, for seams on which few of them are free or are not far enough apart.
DENSE = Density(1000, 24, 5)
#: As many values of a parameter of all places, thinned out for the sake of time.
FINE = Density(400, 24, 5)


class Nodes(NamedTuple):
    """Configurations of places, place by place.

    Args:
        joints: Shape (m, n).
        firsts: Index of the first of each place, and m, shape (l + 1,).
    """

    joints: Array
    firsts: NDArray[np.int64]

    @classmethod
    def of(cls, rows: Sequence[Array]) -> "Nodes":
        """Those of each place (k, n)."""
        firsts = np.cumsum([0, *(len(row) for row in rows)])
        return cls(np.ascontiguousarray(np.concatenate(rows)), firsts)

    def begun_at(self, joints: Array) -> "Nodes":
        """The same with others at the first place, shape (k, n)."""
        return Nodes.of([joints, *np.split(self.joints, self.firsts[1:-1])[1:]])


def sample_deviations(tolerance: ToolTolerance, is_redundant: bool) -> Array:
    """Deviations within a tolerance on a grid, shape (g, 6), the least first.

    Args:
        tolerance: The box.
        is_redundant: Whether the arm has a parameter of its own, so that fewer will do.
    """
    coarse = _ANGLE
    # Deviations of one place at most.
    max_deviations = 48
    while True:
        values = [_values(tolerance, k, coarse, is_redundant) for k in range(SIZE)]
        if math.prod(len(v) for v in values) <= max_deviations or coarse > math.pi:
            break
        coarse *= 1.3
    grid = np.array(list(product(*values)))
    within = tilts(grid) <= tolerance.tilt + 1e-9
    grid = grid[within] if within.any() else grid[:1]
    size = np.abs(grid)
    size[:, RX:] = np.minimum(size[:, RX:], _FULL_TURN - size[:, RX:])
    return np.asarray(grid[np.argsort(size.sum(axis=1), kind="stable")][:max_deviations])


def _values(tolerance: ToolTolerance, column: int, step: float, few: bool) -> Array:
    """Values of one deviation."""
    low, high = float(tolerance.lower[column]), float(tolerance.upper[column])
    if low == high:
        return np.array([low])
    if not math.isfinite(low):
        # Samples of a free turn of an arm with a parameter of its own.
        count = min(12 if few else 24, max(3, math.ceil(_FULL_TURN / step)))
        return np.asarray(np.arange(count) * _FULL_TURN / count)
    if column < RX:
        middle = 0.5 * (low + high)
        # Range of position that is sampled at its ends too [m].
        return np.array([low, middle, high] if high - low > 4e-3 else [middle])
    if column in (RX, RY) and math.isfinite(tolerance.tilt):
        inner = 0.65 * tolerance.tilt
        return np.array([-inner, 0.0, inner])
    count = min(max(2, math.ceil((high - low) / step)) + 1, 9)
    return np.linspace(low, high, count | 1)


def nodes(
    chain: Chain,
    places: SeamPlaces,
    layers: NDArray[np.int64],
    seed: Array,
    density: Density = COARSE,
) -> Nodes:
    """Configurations inside the limits at some places of a seam.

    Args:
        chain: The robot; its tip is the tool.
        places: Places of the seam.
        layers: Indices of the places.
        seed: Configuration that whole turns are to be near, shape (n,).
        density: Density of the configurations.
    """
    carried = _carried_arm(chain)
    is_redundant = chain.n > 6
    targets, counts = [], []
    grids: dict[int, Array] = {}
    for k in layers:
        tolerance = places.tolerances[k]
        if id(tolerance) not in grids:
            grids[id(tolerance)] = sample_deviations(tolerance, is_redundant)
        grid = grids[id(tolerance)]
        nominal = np.broadcast_to(places.nominal[k], (len(grid), 4, 4))
        targets.append(tolerance.poses(nominal, grid))
        counts.append(len(grid))
    T = np.ascontiguousarray(np.concatenate(targets))
    if structure(chain) is not None:
        joints, owner = _closed_form(chain, T, seed, density.parameters)
    elif carried is not None:
        joints, owner = _by_carrier(chain, carried, T, seed, density.carried)
    else:
        joints, owner = _search(chain, T, seed)
    joints, owner = _with_turns(chain, joints, owner)
    layer = np.repeat(np.arange(len(layers)), counts)[owner]
    rows = [_thinned(joints[layer == k], density.most) for k in range(len(layers))]
    return Nodes.of(rows)


def _thinned(joints: Array, most: int) -> Array:
    """Configurations (k, n), evenly thinned out where there are too many."""
    if len(joints) <= most:
        return joints
    return np.asarray(joints[np.linspace(0, len(joints) - 1, most).astype(int)])


def _with_turns(
    chain: Chain, joints: Array, owner: NDArray[np.int64]
) -> tuple[Array, NDArray[np.int64]]:
    """Configurations and those a whole turn on, of joints with room for it but not for two."""
    lower, upper = chain.limits.lower, chain.limits.upper
    span = upper - lower
    for j in np.flatnonzero((span > _FULL_TURN) & (span < TWO_TURNS)):
        if chain.joint_types[j] != JointType.REVOLUTE:
            continue
        for turn in (_FULL_TURN, -_FULL_TURN):
            value = joints[:, j] + turn
            fits = np.flatnonzero((value >= lower[j]) & (value <= upper[j]))
            more = joints[fits].copy()
            more[:, j] += turn
            joints, owner = np.concatenate([joints, more]), np.concatenate([owner, owner[fits]])
    return joints, owner


def _closed_form(
    chain: Chain, T: Array, seed: Array, values: int
) -> tuple[Array, NDArray[np.int64]]:
    """Branches inside the limits, and the pose of each."""
    form = structure(chain)
    parameters = None
    if form is not None and form.redundant:
        at = parameter(chain, seed)
        if form.locked is None:
            parameters = at + np.arange(values) * _FULL_TURN / values
        else:
            low, high = chain.sampling_bounds()
            parameters = np.linspace(low[form.locked], high[form.locked], values + 2)[1:-1]
    table = branches(chain, T, seed_joints=seed, parameters=parameters)
    assert table.counts is not None
    rows = np.arange(table.table.shape[1])[None] < table.counts[:, None]
    owner, row = np.nonzero(rows & table.within_limits)
    return table.joints[owner, row], owner


def _carried_arm(chain: Chain) -> Chain | None:
    """The arm without the joint that carries it, seen from that joint, if it has a closed form."""
    if chain.n < 7 or structure(chain) is not None:
        return None
    names = ("lower", "upper", "velocity", "acceleration", "jerk", "effort")
    limits = Limits(*(getattr(chain.limits, name)[1:] for name in names))
    tip = chain.tip
    arm = Chain(
        name=chain.name,
        joint_names=chain.joint_names[1:],
        joint_types=chain.joint_types[1:],
        offsets=chain.offsets[1:],
        links=(
            replace(chain.link(chain.base_link), joint=-1, T_joint_link=np.eye(4)),
            replace(tip, joint=tip.joint - 1),
        ),
        base_link=chain.base_link,
        tip_link=chain.tip_link,
        limits=limits,
        continuous=chain.continuous[1:],
    )
    return arm if structure(arm) is not None else None


def _by_carrier(
    chain: Chain, arm: Chain, T: Array, seed: Array, parameters: int
) -> tuple[Array, NDArray[np.int64]]:
    """Configurations of a carried arm: the closed form at some values of the first joint."""
    low, high = chain.sampling_bounds()
    # Values of a joint that carries the arm, such as a rail.
    values = np.linspace(low[0], high[0], 9)[1:-1]
    all_joints, owners = [], []
    for value in np.append(values, seed[0]):
        T_carrier = chain.offsets[0] @ _moved(chain, float(value))
        seen = np.ascontiguousarray(inverse(T_carrier) @ T)
        joints, owner = _closed_form(arm, seen, seed[1:], parameters)
        all_joints.append(np.column_stack([np.full(len(joints), value), joints]))
        owners.append(owner)
    return np.concatenate(all_joints), np.concatenate(owners)


def _moved(chain: Chain, value: float) -> Array:
    """Motion of the first joint by its value, shape (4, 4)."""
    if chain.joint_types[0] == JointType.REVOLUTE:
        return transform(from_axis_angle([0.0, 0.0, 1.0], value))
    return transform(None, [0.0, 0.0, value])


def _search(chain: Chain, T: Array, seed: Array) -> tuple[Array, NDArray[np.int64]]:
    """Configurations that the numeric method finds from several starts."""
    random = np.random.default_rng(0)
    low, high = chain.sampling_bounds()
    # Rounds of the numeric search for arms without a closed form.
    starts = [seed, middle(chain), *(random.uniform(low, high) for _ in range(2))]
    joints, owners = [], []
    for number, start in enumerate(starts):
        # Starts of the numeric search in each.
        options = numeric.SearchOptions(number, 20)
        found = numeric.solve_many(chain, T, options, seed_joints=start)
        solved = np.flatnonzero(found.solved)
        joints.append(found.joints[solved])
        owners.append(solved)
    return np.concatenate(joints), np.concatenate(owners)
