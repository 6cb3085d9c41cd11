"""A sheet of formulas as one page of LaTeX or plain text."""

from collections.abc import Iterable, Iterator

from dynamics.equations.sheet import Matrix, Motion, Sheet
from dynamics.equations.writing import Notation


def write_page(sheet: Sheet) -> str:
    """All formulas on one page.

    LaTeX uses ``bmatrix`` of amsmath; plain text has one entry a line.

    Args:
        sheet: The formulas.
    """
    lines = _latex(sheet) if sheet.notation is Notation.LATEX else _text(sheet)
    return "\n".join(lines) + "\n"


def _latex(sheet: Sheet) -> Iterator[str]:
    for symbol, meaning in sheet.abbreviations:
        yield rf"\[ {symbol} = {meaning} \]"
    for i, step in enumerate(sheet.transformations, start=1):
        yield _latex_matrix(f"H_{{{i}}}^{{{i - 1}}}", step)
    yield _latex_matrix(r"\begin{bmatrix} R & O \end{bmatrix}", sheet.frame)
    yield _latex_matrix("J(q)", sheet.jacobian)
    if sheet.determinant is not None:
        yield rf"\[ \det J = {sheet.determinant} \]"
    if sheet.motion is None:
        return
    motion = sheet.motion
    yield rf"\[ {motion.equation} \]"
    yield _latex_matrix("D(q)", motion.mass_matrix)
    for i, j, k, symbol in motion.christoffel_symbols or ():
        yield rf"\[ c_{{{i}{j}{k}}} = {symbol} \]"
    yield _latex_matrix(r"C(q, \dot{q})", motion.coriolis_matrix)
    yield rf"\[ \mathcal{{U}}(q) = {motion.potential_energy} \]"
    yield _latex_matrix("G(q)", _column(motion.gravity))
    if motion.regressor is not None:
        yield _latex_matrix(r"Y(q, \dot{q}, \ddot{q})", motion.regressor.regressor)
        yield _latex_matrix(r"\Theta", _column(motion.regressor.parameters))


def _column(entries: Iterable[str]) -> Matrix:
    return tuple((entry,) for entry in entries)


def _latex_matrix(name: str, rows: Matrix) -> str:
    body = r" \\ ".join(" & ".join(row) for row in rows)
    return rf"\[ {name} = \begin{{bmatrix}} {body} \end{{bmatrix}} \]"


def _text(sheet: Sheet) -> Iterator[str]:
    for symbol, meaning in sheet.abbreviations:
        yield f"{symbol} = {meaning}"
    for i, step in enumerate(sheet.transformations, start=1):
        yield from _entries(f"H_{i}", step)
    yield from _entries("T", sheet.frame)
    yield from _entries("Jacobian", sheet.jacobian)
    if sheet.determinant is not None:
        yield f"det_J = {sheet.determinant}"
    if sheet.motion is not None:
        yield from _text_motion(sheet.motion)


def _text_motion(motion: Motion) -> Iterator[str]:
    yield motion.equation
    yield from _entries("D", motion.mass_matrix)
    for i, j, k, symbol in motion.christoffel_symbols or ():
        yield f"c_{i}{j}{k} = {symbol}"
    yield from _entries("C", motion.coriolis_matrix)
    yield f"U = {motion.potential_energy}"
    yield from _entries("G", _column(motion.gravity))
    if motion.regressor is not None:
        yield from _entries("Y", motion.regressor.regressor)
        yield from _entries("Theta", _column(motion.regressor.parameters))


def _entries(name: str, rows: Matrix) -> Iterator[str]:
    """One line for each entry of a matrix that is not 0."""
    for i, row in enumerate(rows, start=1):
        for j, entry in enumerate(row, start=1):
            if entry != "0":
                index = f"{i}" if len(row) == 1 else f"{i}{j}"
                yield f"{name}_{index} = {entry}"
