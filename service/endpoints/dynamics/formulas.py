"""Formulas of a robot from domain to wire."""

from dataclasses import asdict

from armwright_wire import dynamics as schema
from dynamics.equations.page import write_page
from dynamics.equations.sheet import Motion, Sheet
from dynamics.equations.writing import Notation
from kinematics.model.chain import Chain


def equations_answer(chain: Chain, sheet: Sheet) -> schema.EquationsAnswer:
    """The formulas of a robot as they are answered.

    Args:
        chain: The robot.
        sheet: Its formulas.
    """
    kinds = [row.type for row in sheet.table.rows]
    joints = zip(chain.joint_names, sheet.joints, kinds, strict=True)
    return schema.EquationsAnswer(
        format="latex" if sheet.notation is Notation.LATEX else "text",
        convention=sheet.table.convention,
        joints=[
            schema.JointSymbol(joint=name, symbol=symbol, type=kind)
            for name, symbol, kind in joints
        ],
        parameters=[schema.ParameterSymbol(**asdict(item)) for item in sheet.parameters],
        abbreviations=[
            schema.Abbreviation(symbol=symbol, formula=formula)
            for symbol, formula in sheet.abbreviations
        ],
        transformations=[_rows(step) for step in sheet.transformations],
        pose=schema.PoseFormulas(
            link=chain.tip_link,
            position=[row[3] for row in sheet.frame],
            rotation_matrix=[list(row[:3]) for row in sheet.frame],
        ),
        jacobian=_rows(sheet.jacobian),
        dynamics=None if sheet.motion is None else _motion(sheet.motion),
        notes=list(sheet.notes),
        document=write_page(sheet),
    )


def _rows(matrix: tuple[tuple[str, ...], ...]) -> list[list[str]]:
    return [list(row) for row in matrix]


def _motion(motion: Motion) -> schema.MotionFormulas:
    symbols, regressor = motion.christoffel_symbols, motion.regressor
    return schema.MotionFormulas(
        equation=motion.equation,
        mass_matrix=_rows(motion.mass_matrix),
        christoffel_symbols=None
        if symbols is None
        else [
            schema.ChristoffelFormula(i=i, j=j, k=k, formula=formula)
            for i, j, k, formula in symbols
        ],
        coriolis_matrix=_rows(motion.coriolis_matrix),
        potential_energy=motion.potential_energy,
        gravity=list(motion.gravity),
        regressor=None
        if regressor is None
        else schema.RegressorFormulas(
            regressor=_rows(regressor.regressor),
            parameters=list(regressor.parameters),
            values=list(regressor.values),
        ),
    )
