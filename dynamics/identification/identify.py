"""Identification of a robot, or of its load, from logs of motions and torques."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynamics.identification.consistent import PARAMETERS, Measured, body_of, fit_bodies
from dynamics.identification.least_squares import Weighted, solve, weigh
from dynamics.identification.log import Log, read_log
from dynamics.identification.unknowns import Drive, Unknowns, with_believed_bodies
from dynamics.model.payload import IdentifiedBodies, with_bodies
from dynamics.parameters.base_parameters import combination_text, parameter_unit, regroup
from kinematics.arrays import Array
from kinematics.errors import InvalidLinkName, InvalidOption
from kinematics.model.chain import Chain, Inertia

_ALL: tuple[Drive, ...] = ("motor_inertia", "viscous_friction", "coulomb_friction", "offset")
#: Residuals that are alike from instant to instant to this factor are told.
_ALIKE = 2.0
#: The squared noise may grow by so much, in standard deviations of what it is, before it is told
#: that no rigid bodies fit.
_MISFIT = 5.0


@dataclass(frozen=True, slots=True)
class FoundParameter:
    """A combination of parameters that logs determine.

    Args:
        name: The combination, for example "Izz1 + 0.25 m2".
        unit: Its unit.
        value: Its least-squares value.
        standard_error: Standard deviation of that value.
        consistent: Its value of the bodies with positive densities that fit best.
        believed: Its value of the robot as it was given; 0 for a load.
        excited: Whether the standard error is below what such a parameter usually is.
    """

    name: str
    unit: str
    value: float
    standard_error: float
    consistent: float
    believed: float
    excited: bool


@dataclass(frozen=True, slots=True, eq=False)
class Identification:
    """Parameters found from logs.

    Args:
        parameters: Combinations that the logs determine.
        covariance: Of their values, shape (b, b).
        not_excited: Combinations that motions of the robot can determine and these logs do not,
            each with why.
        residuals: Root mean square of what the least-squares values leave of torques, shape (n,).
        consistent_residuals: The same of the bodies found, shape (n,) [N m or N].
        torques: Root mean square of the torques, shape (n,) [N m or N].
        condition: Condition number of the weighted equations, their columns scaled.
        samples: Number of instants that count.
        offsets: Constant torques of the sensors, shape (n,) [N m or N]; no part of a robot.
        robot: The robot with what was found; of a load the robot as it is.
        bodies: Bodies and drives that were found, as robots are given them; None of a load.
        load: The load in its link's frame; None of a robot.
        link: The link that carries the load.
        notes: Notes on the logs and the fit.
    """

    parameters: tuple[FoundParameter, ...]
    covariance: Array
    not_excited: tuple[str, ...]
    residuals: Array
    consistent_residuals: Array
    torques: Array
    condition: float
    samples: int
    offsets: Array
    robot: Chain
    bodies: IdentifiedBodies | None = None
    load: Inertia | None = None
    link: str | None = None
    notes: tuple[str, ...] = ()


def identify(
    chain: Chain,
    logs: Log | Sequence[Log],
    *,
    drives: Sequence[Drive] = _ALL,
    cutoff: float | None = None,
) -> Identification:
    """Identify the bodies and drives of a robot from logs.

    Args:
        chain: The robot as it is believed to be; what logs do not determine stays near it.
        logs: One log or several.
        drives: Parameters of the drives to be found too; others are those of the robot.
        cutoff: Cutoff of the low-pass filter without delay [Hz]; where none is given 10 Hz, or no
            filter where velocities and accelerations are measured.

    Raises:
        InvalidOption: Logs are malformed, too short, or too few for the parameters.
        InvalidRobotState: Rows have the wrong length or are not finite.
    """
    given, bare = with_believed_bodies(chain)
    notes = [f"joint {name} had no inertia: 1 kg is believed in" for name in bare]
    found, x = _identify(Unknowns(given, tuple(drives)), logs, cutoff)
    split = PARAMETERS * chain.n
    values = x[split:].reshape(len(drives), chain.n)
    named: dict[Drive, Array] = dict(zip(drives, values, strict=True))
    bodies = IdentifiedBodies.of(given, [body_of(row) for row in x[:split].reshape(chain.n, -1)])
    bodies = replace(
        bodies,
        motor_inertia=named.get("motor_inertia"),
        viscous_friction=named.get("viscous_friction"),
        coulomb_friction=named.get("coulomb_friction"),
    )
    return replace(
        found,
        offsets=named.get("offset", np.zeros(chain.n)),
        robot=with_bodies(chain, bodies),
        bodies=bodies,
        notes=(*notes, *found.notes),
    )


def identify_payload(
    chain: Chain,
    logs: Log | Sequence[Log],
    *,
    link: str | None = None,
    offsets: bool = False,
    cutoff: float | None = None,
) -> Identification:
    """Identify a load that a robot carries, all else being known.

    Poses at rest determine mass and centre of mass; the inertia takes motions.

    Args:
        chain: The robot without the load.
        logs: One log or several.
        link: Link that carries the load; the tip where none is named.
        offsets: Constant torques of the sensors are to be found too.
        cutoff: Cutoff of the low-pass filter without delay [Hz].

    Raises:
        InvalidLinkName: No such link, or it stands still.
        InvalidOption: Logs are malformed, too short, or too few for the parameters.
        InvalidRobotState: Rows have the wrong length or are not finite.
        MissingInertia: The robot has no inertias.
    """
    carrier = chain.link(link or chain.tip_link)
    if not 0 <= carrier.joint < chain.n:
        raise InvalidLinkName(f"no joint of the chain moves link {carrier.name!r}")
    drives: tuple[Drive, ...] = ("offset",) if offsets else ()
    found, x = _identify(Unknowns(chain, drives, carrier.name), logs, cutoff)
    constant = x[PARAMETERS:] if offsets else np.zeros(chain.n)
    load = body_of(x[:PARAMETERS])
    return replace(found, offsets=constant, load=load, link=carrier.name)


def _identify(
    unknowns: Unknowns, logs: Log | Sequence[Log], cutoff: float | None
) -> tuple[Identification, Array]:
    """What is found but for bodies, and the consistent parameters (p,)."""
    chain, base = unknowns.chain, unknowns.base
    given = [logs] if isinstance(logs, Log) else list(logs)
    if not given or not all(isinstance(log, Log) for log in given):
        raise InvalidOption("there are no logs", hint="Give a Log, or a list of them.")
    every = [read_log(chain, log, cutoff) for log in given]
    Y = [one.reduce(base.regressor(unknowns.regressor(one.q, one.qd, one.qdd))) for one in every]
    tau = [one.reduce(one.tau - unknowns.known_torques(one)) for one in every]
    weighted = weigh(Y, tau)
    torque = _mean_square(np.concatenate([one.tau for one in every]))
    sizes = unknowns.sizes(torque)
    columns, counted = regroup(weighted.R, range(base.count))
    solution = solve(weighted, columns)
    x = _consistent(unknowns, weighted, sizes)
    combination = counted @ base.combination
    errors = np.sqrt(np.diag(solution.covariance))
    leaders = base.columns[columns]
    excited = errors <= sizes[leaders]
    names = [
        combination_text(row, unknowns.names, int(k))
        for row, k in zip(combination, leaders, strict=True)
    ]
    rest, after = (
        np.concatenate([t - y[..., k] @ beta for y, t in zip(Y, tau, strict=True)])
        for k, beta in ((columns, solution.values), (slice(None), base.combination @ x))
    )
    units = [parameter_unit(unknowns.names[int(k)], chain) for k in leaders]
    numbers = [solution.values, errors, combination @ x, combination @ unknowns.known()]
    rows = zip(names, units, np.array(numbers).T.tolist(), excited.tolist(), strict=True)
    found = Identification(
        parameters=tuple(
            FoundParameter(name, unit, value, error, fitted, known, good)
            for name, unit, (value, error, fitted, known), good in rows
        ),
        covariance=solution.covariance,
        not_excited=_not_excited(unknowns, columns, counted, names, errors, excited),
        residuals=_mean_square(rest),
        consistent_residuals=_mean_square(after),
        torques=torque,
        condition=solution.condition,
        samples=len(rest),
        offsets=np.zeros(chain.n),
        robot=chain,
        notes=tuple(_notes(weighted, base.combination @ x, rest.size)),
    )
    return found, x


def _consistent(unknowns: Unknowns, weighted: Weighted, sizes: Array) -> Array:
    split = PARAMETERS * unknowns.bodies
    positive = np.array([not name.startswith("offset") for name in unknowns.names[split:]], bool)
    R = weighted.R @ unknowns.base.combination
    return fit_bodies(Measured(R, weighted.z, unknowns.believed(sizes), unknowns.bodies, positive))


def _not_excited(
    unknowns: Unknowns,
    columns: Sequence[int],
    counted: Array,
    names: Sequence[str],
    errors: Array,
    excited: NDArray[np.bool_],
) -> tuple[str, ...]:
    """Base parameters that logs do not determine, and why."""
    told = []
    for k, name in enumerate(unknowns.base.names):
        if k in columns:
            continue
        others = [names[i] for i in np.flatnonzero(np.abs(counted[:, k]) > 1e-9).tolist()]
        told.append(
            f"{name}: {'counted with ' + '; '.join(others) if others else 'no row depends on it'}"
        )
    for name, error, good in zip(names, errors, excited.tolist(), strict=True):
        if not good:
            told.append(f"{name}: its standard error is {error:.3g}")
    return tuple(told)


def _notes(weighted: Weighted, beta: Array, equations: int) -> list[str]:
    notes = []
    if weighted.inflation > _ALIKE:
        notes.append(
            "residuals are alike from instant to instant: the model leaves something out, or the "
            f"noise is slow; variances are counted {weighted.inflation:.3g} times"
        )
    best = np.linalg.lstsq(weighted.R, weighted.z, rcond=1e-12)[0]
    more = np.sum((weighted.R @ (beta - best)) ** 2) / weighted.inflation
    limit = len(beta) + _MISFIT * np.sqrt(2.0 * len(beta))
    if more > limit:
        notes.append(
            f"no bodies with positive densities fit as well as the least squares: by {more:.3g}, "
            f"in units of the squared noise of {equations} torques, where {limit:.3g} is usual"
        )
    return notes


def _mean_square(rows: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(rows**2, axis=0)))
