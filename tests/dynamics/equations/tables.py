"""Tables that tests of formulas use, and the values of written formulas by sympy."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import sympy

from dynamics.equations.formula import Notation
from dynamics.equations.sheet import Sheet, write_sheet
from kinematics.model.dh import DhRow, DhTable

Q = sympy.symbols("q_1:4")
QD = sympy.symbols("qd_1:4")
QDD = sympy.symbols("qdd_1:4")


def bar(length: float, center: float, inertia: float, **changes: Any) -> DhRow:
    """A link along its x axis that turns about z; the centre of mass from the axis before it."""
    return DhRow(
        "revolute",
        a=length,
        mass=changes.pop("mass", 1.5),
        center_of_mass=[center - length, 0.0, 0.0],
        inertia=np.diag([1e-4, inertia, inertia]),
        **changes,
    )


def planar_arm(n: int = 2) -> DhTable:
    """Links that turn in one plane, gravity along -y: the planar RR of lecture 27 for n = 2."""
    rows = tuple(bar(0.6 - 0.1 * i, 0.25 - 0.03 * i, 0.06 + 0.01 * i, mass=2.0 - 0.3 * i)
                 for i in range(n))  # fmt: skip
    return DhTable("standard", rows, gravity=np.array([0.0, -9.81, 0.0]))


def cart_pendulum() -> DhTable:
    """The pendulum on a cart of lecture 26, with the table of the notes."""
    inertia = np.diag([1e-3, 2e-3, 3e-3])
    cart = DhRow("prismatic", alpha=-math.pi / 2, mass=1.2, inertia=inertia)
    pendulum = DhRow("revolute", a=0.7, mass=0.3, center_of_mass=[-0.2, 0, 0], inertia=inertia)
    return DhTable("standard", (cart, pendulum), gravity=np.array([-9.81, 0.0, 0.0]))


def articulated_arm() -> DhTable:
    """Three revolute joints, the first vertical, with motors and friction at the joints."""
    full = np.array([[0.3, 0.01, 0.02], [0.01, 0.4, 0.03], [0.02, 0.03, 0.5]])
    drive = {"motor_inertia": 0.1, "viscous_friction": 0.2, "coulomb_friction": 0.3}
    rows = (
        DhRow("revolute", d=0.4, alpha=math.pi / 2, mass=2.0, center_of_mass=[0.0, -0.1, 0.02],
              inertia=full, **drive),
        DhRow("revolute", a=0.5, mass=1.5, center_of_mass=[-0.2, 0.01, 0.03],
              inertia=full, **drive),
        DhRow("revolute", a=0.3, theta=math.pi / 2, mass=1.0, center_of_mass=[-0.1, 0, 0],
              inertia=np.diag([0.01, 0.02, 0.03])),
    )  # fmt: skip
    return DhTable("standard", rows)


def odd_arm(convention: str = "standard") -> DhTable:
    """Angles that are no quarter turns, a slide, a tilted base and tool, slanted gravity."""
    tilt = np.eye(4)
    tilt[:3, :3] = [[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]]
    tilt[:3, 3] = [0.1, 0.0, 0.3]
    rows = (
        DhRow("revolute", a=0.2, alpha=0.4, d=0.1, theta=0.7, mass=2.0, center_of_mass=[0.1, 0, 0]),
        DhRow("prismatic", a=0.3, alpha=-math.pi / 2, d=0.15, theta=0.2, mass=1.0,
              inertia=np.diag([0.1, 0.2, 0.25])),
        DhRow("revolute", a=0.25, alpha=math.pi, theta=-0.3, mass=0.5),
    )  # fmt: skip
    gravity = np.array([1.0, 0.5, -9.7])
    assert convention in ("standard", "modified")
    kind: Any = convention
    return DhTable(kind, rows, base=tilt, tool=tilt, gravity=gravity)


TABLES = {
    "planar": planar_arm(),
    "planar of three": planar_arm(3),
    "cart": cart_pendulum(),
    "articulated": articulated_arm(),
    "odd": odd_arm(),
    "odd, modified": odd_arm("modified"),
}


def text_sheet(table: DhTable) -> Sheet:
    return write_sheet(table, Notation.TEXT)


def parse(sheet: Sheet, text: str) -> Any:
    """A written formula as a sympy expression in q_i, their derivatives and the parameters."""
    names = {str(s): s for s in (*Q, *QD, *QDD)}
    names |= {p.symbol: sympy.Symbol(p.symbol) for p in sheet.parameters}
    functions = {"cos": sympy.cos, "sin": sympy.sin, "tanh": sympy.tanh}
    for symbol, meaning in sheet.abbreviations:
        names[symbol] = sympy.sympify(meaning, locals=names | functions)
    return sympy.sympify(text, locals=names, rational=True)


def evaluate(sheet: Sheet, formulas: Any, state: Mapping[str, float]) -> Any:
    """Values of an array of written formulas, which Python evaluates as they stand."""
    functions = {"cos": math.cos, "sin": math.sin, "tanh": math.tanh}
    values: dict[str, Any] = {p.symbol: p.value for p in sheet.parameters} | dict(state) | functions
    for symbol, meaning in sheet.abbreviations:
        values[symbol] = eval(meaning, {}, values)
    array = np.array(formulas, dtype=object)
    numbers = [eval(text, {}, values) for text in array.ravel().tolist()]
    return np.array(numbers).reshape(array.shape)


def state(q: Any, qd: Any, qdd: Any) -> dict[str, float]:
    """Values of the symbols of a state of motion."""
    rows = (("q", q), ("qd", qd), ("qdd", qdd))
    return {f"{name}_{i}": float(v) for name, row in rows for i, v in enumerate(row, start=1)}
