"""Lyapunov functions as requests ask for them, in workers."""

from typing import Any

import numpy as np
from pydantic_core import to_json

from armwright_wire.robots.lyapunov import LyapunovRequest, PendulumParameters
from kinematics.errors import InvalidOption
from service.fields import listed
from service.workers.task import task
from tracking.controllers.quadratic_form import (
    SymmetricForm,
    Verdict,
    form_text,
    quadratic_lyapunov,
    solve_lyapunov,
)

_VERDICTS = {
    Verdict.ASYMPTOTICALLY_STABLE: "asymptotically_stable",
    Verdict.STABLE_BY_LASALLE: "asymptotically_stable",
    Verdict.STABLE: "stable",
    Verdict.UNSTABLE: "unstable",
    Verdict.NO_POSITIVE_V: "nothing",
    Verdict.NO_FALL: "nothing",
}


_ASYMMETRIC = "P is not symmetric: its symmetric part (P + Pᵀ)/2, which has the same V, was taken"


@task
def lyapunov(content: bytes) -> bytes:
    """Answer a request to examine V = x^T P x, to solve for P, or to examine a formula.

    Raises:
        InvalidOption: Sizes do not fit, a matrix is not what it must be, P is not determined, or a
            formula can't be read.
    """
    body = LyapunovRequest.model_validate_json(content)
    if body.A is None:
        return to_json(_nonlinear(body))
    for name in ("A", "P", "Q"):
        _check_rows(name, getattr(body, name))
    if body.P is not None:
        examined = quadratic_lyapunov(body.A, body.P)
    else:
        assert body.Q is not None
        examined = solve_lyapunov(body.A, body.Q)
    texts = form_text(examined.P.matrix), form_text(-examined.Q.matrix)
    answer = _answer(examined, _VERDICTS[examined.verdict], examined.verdict.value, texts)
    if not examined.is_symmetric:
        answer["notes"] = [_ASYMMETRIC]
    if body.x is not None:
        _check_states(body.x, len(body.A), f"A has {len(body.A)} rows")
        V, V_dot = examined.values(body.x)
        answer |= {"values": V.tolist(), "rates": V_dot.tolist()}
    return to_json(answer)


def _nonlinear(body: LyapunovRequest) -> dict[str, Any]:
    """The answer of a V that is a formula.

    Raises:
        InvalidOption: A formula can't be read or is not 0 at x = 0, or a state does not fit.
    """
    # sympy takes half a second to load: only requests that need it wait for it.
    from tracking.controllers.nonlinear_form import nonlinear_lyapunov  # noqa: PLC0415
    from tracking.controllers.state_formulas import read_formula, write  # noqa: PLC0415

    texts, V = (body.f, body.V) if body.parameters is None else _pendulum(body.parameters)
    assert texts is not None
    assert V is not None
    n = len(texts)
    f = [read_formula(f"f[{i}]", text, n) for i, text in enumerate(texts)]
    examined = nonlinear_lyapunov(f, read_formula("V", V, n))
    answer = _answer(
        examined, examined.verdict, examined.reason, (write(examined.V), write(examined.V_dot))
    )
    answer["f"] = [write(one) for one in f]
    if examined.zeros is not None:
        answer["lasalle"] = {
            "set": [write(one) for one in examined.zeros],
            "invariant": [write(one) for one in examined.invariant],
        }
    if body.x is not None:
        _check_states(body.x, n, f"f has {n} formulas")
        values, rates = examined.values(np.array(body.x))
        answer |= {"values": values.tolist(), "rates": rates.tolist()}
    return answer


def _pendulum(of: PendulumParameters) -> tuple[list[str], str]:
    """System and energy of a pendulum, as formulas."""
    m, l, g, b = of.mass, of.length, of.gravity, of.damping  # noqa: E741
    f = ["x2", f"-{g}/{l}*sin(x1) - {b}/({m}*{l}**2)*x2"]
    return f, f"{m}*{l}**2*x2**2/2 + {m}*{g}*{l}*(1 - cos(x1))"


def _check_states(x: list[Any], n: int, size: str) -> None:
    """Refuse states that have not one number for each row of A, or each formula."""
    rows = x if isinstance(x[0], list) else [x]
    wrong = next((i for i, row in enumerate(rows) if len(row) != n), None)
    if wrong is not None:
        name = f"x[{wrong}]" if rows is x else "x"
        raise InvalidOption(
            f"{name} has {len(rows[wrong])} number(s), {size}",
            hint="Give one number for each of them.",
        )


def _check_rows(name: str, rows: list[list[float]] | None) -> None:
    """Refuse a matrix whose rows are not as long as there are rows."""
    wrong = next((i for i, row in enumerate(rows or []) if len(row) != len(rows or [])), None)
    if rows is not None and wrong is not None:
        raise InvalidOption(
            f"{name}[{wrong}] has {len(rows[wrong])} number(s), {name} has {len(rows)} rows",
            hint="Give a square matrix as rows.",
        )


def _answer(examined: Any, verdict: str, reason: str, formulas: tuple[str, str]) -> dict[str, Any]:
    """Fields of an answer, V and dV/dt as formulas."""
    return {
        "f": None,
        "P": _form(examined.P),
        "Q": _form(examined.Q),
        "V": formulas[0],
        "V_dot": formulas[1],
        "verdict": verdict,
        "reason": reason,
        "lasalle": None,
        "poles": [{"real": p.real, "imaginary": p.imag} for p in examined.poles.tolist()],
        "values": None,
        "rates": None,
        "notes": [],
    }


def _form(form: SymmetricForm) -> dict[str, Any]:
    arrays = listed(form, "matrix", "minors", "eigenvalues")
    return arrays | {"definiteness": form.definiteness.value}
