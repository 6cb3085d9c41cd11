"""Units of the dynamic parameters, and labels as textbooks write them: "m2·lc2 [kg m]"."""

import numpy as np

from dynamics.parameters.base_parameters import BaseParameters, combination_text
from dynamics.parameters.regressor import standard_parameters
from kinematics.arrays import Array
from kinematics.model.chain import Chain, JointType

#: First moments by their axis, as the textbooks call the coordinates of a centre of mass.
_FIRST_MOMENTS = {"mx": "xc", "my": "yc", "mz": "zc"}
#: Units of a joint's motor inertia, viscous and dry friction: of a revolute and a prismatic one.
_JOINT_UNITS = {"J": ("kg m²", "kg"), "B": ("N m s/rad", "N s/m"), "F": ("N m", "N")}


def parameter_unit(name: str, chain: Chain) -> str:
    """The unit of a standard parameter, for example "kg m" of "mx2".

    Args:
        name: Name as in ``dynamics.parameters.regressor.parameter_names``: a kind and the number of a joint.
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
