"""The fewest parameters that the equations of motion depend on, by a QR decomposition.

Labels are those of textbooks: "m2·lc2 [kg m]".
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from dynamics.parameters.regressor import parameter_names, regressor, standard_parameters
from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain, JointType

#: First moments by their axis, as the textbooks call the coordinates of a centre of mass.
_FIRST_MOMENTS = {"mx": "xc", "my": "yc", "mz": "zc"}
#: Units of a joint's motor inertia, viscous and dry friction, and of a constant torque that its
#: sensor adds: of a revolute and a prismatic one.
_JOINT_UNITS = {
    "J": ("kg m²", "kg"),
    "B": ("N m s/rad", "N s/m"),
    "F": ("N m", "N"),
    "offset": ("N m", "N"),
}

#: Of a column that is a combination of others so much of its length is left: rounding errors,
#: magnified by how alike columns are. Of columns that are not, some hundredths are left.
_DEPENDENT = 1e-8
#: A coefficient below this part of the largest is rounding error.
_ZERO = 1e-9
#: Random motions, as many equations for each unknown: one would do but for bad luck.
_EQUATIONS = 4
#: Within a body: first what stays, last what can be counted with the body before.
_ORDER = ("Izz", "Ixx", "Ixy", "Ixz", "Iyz", "mx", "my", "Iyy", "mz", "m")


@dataclass(frozen=True, slots=True, eq=False)
class BaseParameters:
    """A minimal parametrisation tau = Y_b beta, with beta = combination Theta.

    Args:
        columns: Columns of Y that make up Y_b, shape (b,).
        combination: Shape (b, p).
        values: beta of the robot's own parameters, shape (b,).
        names: Each beta as the combination that it is, for example "Izz1 + 0.25 m2".
        parameter_names: The names of Theta's p entries.
    """

    columns: NDArray[np.int64]
    combination: Array
    values: Array
    names: tuple[str, ...]
    parameter_names: tuple[str, ...]

    def __post_init__(self) -> None:
        self.columns.setflags(write=False)
        for name in ("combination", "values"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def count(self) -> int:
        """Number of base parameters."""
        return len(self.names)

    def regressor(self, Y: Array) -> Array:
        """The columns Y_b (..., n, b) of a regressor Y (..., n, p)."""
        return np.asarray(Y[..., self.columns])

    def select(self, indices: Sequence[int]) -> "BaseParameters":
        """Some of the base parameters, by their indices."""
        chosen = list(indices)
        names = tuple(self.names[i] for i in chosen)
        columns, rows = self.columns[chosen].copy(), self.combination[chosen]
        return BaseParameters(columns, rows, self.values[chosen], names, self.parameter_names)

    def indices(self, names: Sequence[str]) -> list[int]:
        """Indices of base parameters by their names, or by the parameters that lead them.

        Raises:
            InvalidOption: A name is unknown or stands twice.
        """
        leaders = [self.parameter_names[k] for k in self.columns.tolist()]
        known = dict(zip(leaders, range(self.count), strict=True))
        known |= dict(zip(self.names, range(self.count), strict=True))
        for i, name in enumerate(names):
            if name not in known or known[name] in [known[before] for before in names[:i]]:
                problem = "unknown" if name not in known else "given twice"
                raise InvalidOption(
                    f"the base parameter {name!r} is {problem}",
                    hint=f"Give some of: {'; '.join(self.names)}; or {', '.join(leaders)}.",
                )
        return [known[name] for name in names]

    def of(self, chain: Chain) -> Array:
        """The values beta of another robot of the same kinematics, shape (b,).

        Raises:
            InvalidOption: The vector has another number of parameters.
            MissingInertia: No link that a joint carries has an inertia.
        """
        Theta = standard_parameters(chain, motors="J1" in self.parameter_names)
        if len(Theta) != self.combination.shape[1]:
            raise InvalidOption(
                f"robot {chain.name!r} has {len(Theta)} parameters, "
                f"not {self.combination.shape[1]}",
                hint="Give a robot of the same joints.",
            )
        return np.asarray(self.combination @ Theta)


@lru_cache(maxsize=64)
def base_parameters(
    chain: Chain, *, motors: bool = False, known_zeros: bool = False
) -> BaseParameters:
    """The base parameters of a robot, by numerical QR decomposition.

    Columns of the regressors of many random motions are taken one by one, from the base to the
    tip; one that depends on those before it is regrouped with them ("A numerical method for the
    calculation of the base inertial parameters of robots").

    Args:
        chain: The robot. The gravity it stands under matters: without it fewer can be told apart.
        motors: Whether motor inertias and viscous frictions are parameters.
        known_zeros: Leave out the parameters that are exactly 0 in this robot, as known from its
            construction: the textbooks' planar arm has centres of mass on its links, so 4
            parameters instead of 6.

    Raises:
        MissingInertia: No link that a joint carries has an inertia.
    """
    Theta = standard_parameters(chain, motors=motors)
    Y = regressor(chain, *random_motions(chain), motors=motors)
    W = np.asarray(np.linalg.qr(Y.reshape(-1, Y.shape[-1]), mode="r"))
    names = parameter_names(chain, motors=motors)
    order = [i for i in elimination_order(chain.n, names) if not known_zeros or Theta[i] != 0.0]
    return found_base(W, order, names, Theta)


def found_base(
    W: Array, order: Sequence[int], names: tuple[str, ...], Theta: Array
) -> BaseParameters:
    """The base parameters of stacked regressors.

    Args:
        W: Stacked regressors (r, p), or the triangle of their QR decomposition.
        order: Columns in the order in which they are looked at.
        names: Names of the p parameters.
        Theta: Their values, shape (p,).
    """
    columns, combination = regroup(W, order)
    rows = zip(combination, columns, strict=True)
    text = tuple(combination_text(row, names, k) for row, k in rows)
    chosen = np.array(columns, dtype=np.int64)
    return BaseParameters(chosen, combination, combination @ Theta, text, names)


def random_motions(chain: Chain) -> tuple[Array, Array, Array]:
    """Positions, velocities and accelerations that excite all that can be, each (m, n)."""
    count = _EQUATIONS * len(parameter_names(chain)) // chain.n
    # The same motions always: the choice of columns must not change from call to call.
    rng = np.random.default_rng(0)
    reach = np.where(chain.joint_types == JointType.REVOLUTE, np.pi, 1.0)
    q = rng.uniform(-reach, reach, (count, chain.n))
    qd, qdd = rng.uniform(-3.0, 3.0, (2, count, chain.n))
    return q, qd, qdd


def elimination_order(n: int, names: Sequence[str]) -> list[int]:
    """The order in which columns of a regressor are looked at: what stays comes first."""
    place = {name: i for i, name in enumerate(names)}
    bodies = [place[f"{name}{i}"] for i in range(1, n + 1) for name in _ORDER]
    return [*bodies, *range(10 * n, len(names))]


def regroup(W: Array, order: Sequence[int]) -> tuple[list[int], Array]:
    """Independent columns of W (r, p), and what of all parameters is counted with each.

    Args:
        W: Stacked regressors, or the triangle of their QR decomposition.
        order: Columns in the order in which they are looked at.
    """
    lengths = np.linalg.norm(W, axis=0)
    cut = _DEPENDENT * lengths.max(initial=0.0)
    Q = np.zeros_like(W)
    chosen: list[int] = []
    for k in order:
        rest, basis = np.asarray(W[:, k]), np.asarray(Q[:, : len(chosen)])
        for _ in range(2):  # once leaves rounding errors of the size of what is left
            rest = rest - basis @ (basis.T @ rest)
        left = float(np.linalg.norm(rest))
        if left > _DEPENDENT * lengths[k] and lengths[k] > cut:
            Q[:, len(chosen)] = rest / left
            chosen.append(k)
    combination = np.zeros((len(chosen), W.shape[1]))
    combination[:, order] = np.linalg.lstsq(W[:, chosen], W[:, order], rcond=None)[0]
    largest = np.abs(combination).max(axis=1, keepdims=True)
    combination[np.abs(combination) < _ZERO * largest] = 0.0
    combination[:, chosen] = np.eye(len(chosen))
    return chosen, combination


def combination_text(row: Array, names: Sequence[str], leader: int, times: str = " ") -> str:
    """A combination of parameters as people write it, for example "Izz1 + 0.25 m2".

    Args:
        row: Coefficient of each parameter, shape (p,).
        names: Name of each parameter, p of them.
        leader: Index of the parameter that stands for the combination; it comes first.
        times: Sign between a coefficient and its parameter.
    """
    others = [int(i) for i in np.flatnonzero(row) if i != leader]
    text = names[leader]
    for i in others:
        sign = "-" if row[i] < 0.0 else "+"
        size = f"{abs(row[i]):.6g}"
        text += f" {sign} {names[i]}" if size == "1" else f" {sign} {size}{times}{names[i]}"
    return text


def parameter_unit(name: str, chain: Chain) -> str:
    """The unit of a standard parameter, for example "kg m" of "mx2".

    Args:
        name: Name as in ``regressor.parameter_names``: a kind and the number of a joint.
        chain: The robot: a prismatic joint's motor has other units.
    """
    kind = name.rstrip("0123456789")
    if kind == "m":
        return "kg"
    if kind in _FIRST_MOMENTS:
        return "kg m"
    if kind in _JOINT_UNITS:
        joint = int(name[len(kind) :]) - 1
        return _JOINT_UNITS[kind][int(chain.joint_types[joint] == JointType.PRISMATIC)]
    return "kg m²"


def base_parameter_units(base: BaseParameters, chain: Chain) -> tuple[str, ...]:
    """The unit of each base parameter: that of the parameter that leads it."""
    return tuple(parameter_unit(base.parameter_names[k], chain) for k in base.columns.tolist())


def base_parameter_labels(base: BaseParameters, chain: Chain) -> tuple[str, ...]:
    """Each base parameter as textbooks write it, with its unit, for example "m2·lc2 [kg m]".

    A first moment m x of a body whose centre of mass lies on the x axis of its joint's frame is
    called m lc; m xc, m yc and m zc else.

    Args:
        base: The base parameters.
        chain: The robot that they are of.
    """
    Theta = standard_parameters(chain, motors="J1" in base.parameter_names)
    symbols = [_symbol(name, i, Theta) for i, name in enumerate(base.parameter_names)]
    units = base_parameter_units(base, chain)
    rows = zip(base.combination, base.columns.tolist(), units, strict=True)
    return tuple(f"{combination_text(row, symbols, k, '·')} [{unit}]" for row, k, unit in rows)


def _symbol(name: str, index: int, Theta: Array) -> str:
    """The textbooks' symbol of a standard parameter, the one at ``index`` of Theta (p,)."""
    kind = name.rstrip("0123456789")
    if kind not in _FIRST_MOMENTS:
        return name
    number = name[len(kind) :]
    first = index - tuple(_FIRST_MOMENTS).index(kind)
    on_axis = kind == "mx" and not np.any(Theta[first + 1 : first + 3])
    return f"m{number}·{'lc' if on_axis else _FIRST_MOMENTS[kind]}{number}"
