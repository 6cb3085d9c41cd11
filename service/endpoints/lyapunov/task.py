"""Quadratic Lyapunov functions as requests ask for them, in workers."""

from typing import Any

from pydantic_core import to_json

from armwright_wire.robots.lyapunov import LyapunovRequest
from kinematics.errors import InvalidOption
from service.workers.task import task
from tracking.controllers.quadratic_form import (
    QuadraticLyapunov,
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


@task
def lyapunov(content: bytes) -> bytes:
    """Answer a request to examine V = x^T P x, or to solve for P.

    Raises:
        InvalidOption: Sizes do not fit, a matrix is not what it must be, or P is not determined.
    """
    body = LyapunovRequest.model_validate_json(content)
    for name in ("A", "P", "Q"):
        _check_rows(name, getattr(body, name))
    if body.P is not None:
        examined = quadratic_lyapunov(body.A, body.P)
    else:
        assert body.Q is not None
        examined = solve_lyapunov(body.A, body.Q)
    answer = _answer(examined)
    if body.x is not None:
        _check_states(body.x, len(body.A))
        V, V_dot = examined.values(body.x)
        answer |= {"values": V.tolist(), "rates": V_dot.tolist()}
    return to_json(answer)


def _check_states(x: list[Any], n: int) -> None:
    """Refuse states that have not one number for each row of A."""
    rows = x if isinstance(x[0], list) else [x]
    wrong = next((i for i, row in enumerate(rows) if len(row) != n), None)
    if wrong is not None:
        name = f"x[{wrong}]" if rows is x else "x"
        raise InvalidOption(
            f"{name} has {len(rows[wrong])} number(s), A has {n} rows",
            hint="Give one number for each row of A.",
        )


def _check_rows(name: str, rows: list[list[float]] | None) -> None:
    """Refuse a matrix whose rows are not as long as there are rows."""
    wrong = next((i for i, row in enumerate(rows or []) if len(row) != len(rows or [])), None)
    if rows is not None and wrong is not None:
        raise InvalidOption(
            f"{name}[{wrong}] has {len(rows[wrong])} number(s), {name} has {len(rows)} rows",
            hint="Give a square matrix as rows.",
        )


def _answer(examined: QuadraticLyapunov) -> dict[str, Any]:
    notes = []
    if not examined.is_symmetric:
        notes.append(
            "P is not symmetric: its symmetric part (P + Pᵀ)/2, which has the same V, was taken"
        )
    return {
        "P": _form(examined.P),
        "Q": _form(examined.Q),
        "V": form_text(examined.P.matrix),
        "V_dot": form_text(-examined.Q.matrix),
        "verdict": _VERDICTS[examined.verdict],
        "reason": examined.verdict.value,
        "poles": [{"real": p.real, "imaginary": p.imag} for p in examined.poles.tolist()],
        "values": None,
        "rates": None,
        "notes": notes,
    }


def _form(form: SymmetricForm) -> dict[str, Any]:
    return {
        "matrix": form.matrix.tolist(),
        "minors": form.minors.tolist(),
        "eigenvalues": form.eigenvalues.tolist(),
        "definiteness": form.definiteness.value,
    }
