"""Identification on logs of a real Panda, beside what was published of it and beside peers.

    python -m benchmarks.peers.identification FOLDER [--share 0.7]

The folder is a checkout of FrankaEmikaPandaDynModel (Gaz, Cognetti, Oliva, Robuffo Giordano and De
Luca, RA-L 2019), which has 21 s of positions and torques of an exciting motion at 1 kHz, and the
model that its authors found as formulas. The first part of the log serves to identify, the rest is
predicted: root mean squares of what is left of the torques there, which no method has seen. All get
the same positions, derivatives and filter. The published model was found from other motions of
another Panda. pinocchio's regressor is solved by numpy's least squares, unweighted; figaroh
(`pip install figaroh`) takes part where it is installed.
"""

import argparse
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import armwright as aw
from dynamics.identification.log import Log, Samples, read_log
from dynamics.identification.unknowns import DRIVES, Unknowns
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.robots import builtin_urdf

LOGS = "matlab/data/Exciting_Traj/Trajectory_1/rbt_log/exciting_traj_"
MODEL = "matlab/dyn_model_panda/get_"
#: Step of differences of the published mass matrix [rad].
STEP = 1e-5

Predictor = Callable[[Samples], Array]


def formulas(path: Path, q: Array) -> Array:
    """Values (m, k) of the last list of a file of MATLAB, which depends on joints (m, 7)."""
    text = path.read_text("latin-1")
    text = re.sub(r"%.*", "", text).replace("...", "").replace(".*", "*").replace("./", "/")
    text = text.replace(".^", "**").replace("^", "**")
    values: dict[str, Any] = {f"q{i + 1}": q[:, i] for i in range(7)}
    values |= {"cos": np.cos, "sin": np.sin}
    for name, formula in re.findall(r"^\s*(\w+)\s*=\s*([^;\[]+);", text, re.MULTILINE):
        if not re.fullmatch(r"q\d", name):
            values[name] = evaluated(formula, values)
    (listed,) = re.findall(r"=\s*\[([^\[\]()]*(?:\([^\[\]]*)?)\];?", text)[:1]
    found = [evaluated(formula, values) for formula in re.split(r"[,;]", listed)]
    return np.stack(np.broadcast_arrays(*found), axis=-1)


def evaluated(formula: str, values: dict[str, Any]) -> Any:
    """A sum of products, term by term: all at once is too deep for Python's parser."""
    depth, parts, start = 0, list[str](), 0
    for i, letter in enumerate(formula):
        depth += (letter == "(") - (letter == ")")
        if i > start and letter in "+-" and depth == 0 and formula[i - 1] not in "eE*/(":
            parts.append(formula[start:i])
            start = i
    parts.append(formula[start:])
    return sum(eval(part.strip(), {"__builtins__": {}}, values) for part in parts if part.strip())


def published(folder: Path) -> Predictor:
    """The torques of the published model, its Coriolis terms by differences of its mass matrix."""

    def mass(q: Array) -> Array:
        packed = formulas(folder / f"{MODEL}MassMatrix.m", q)
        M = np.zeros((len(q), 7, 7))
        rows, columns = np.tril_indices(7)
        M[:, rows, columns] = M[:, columns, rows] = packed
        return M

    def predict(one: Samples) -> Array:
        text = (folder / f"{MODEL}FrictionTorque.m").read_text("latin-1")
        block = re.search(r"fp = \[(.*?)\]", text, re.DOTALL)
        assert block is not None
        A, _, shift, alpha = np.array(re.findall(r"-?\d+\.?\d*", block[1]), float).reshape(4, 7)
        friction = A / (1.0 + np.exp(-alpha * (one.qd + shift)))
        friction -= A / (1.0 + np.exp(-alpha * shift))
        D = np.stack(
            [(mass(one.q + step) - mass(one.q - step)) / (2.0 * STEP) for step in STEP * np.eye(7)]
        )
        own = np.einsum("kmij,mk,mj->mi", D, one.qd, one.qd)
        own -= 0.5 * np.einsum("kmij,mi,mj->mk", D, one.qd, one.qd)
        inertia = np.einsum("mij,mj->mi", mass(one.q), one.qdd)
        gravity = formulas(folder / f"{MODEL}GravityVector.m", one.q)
        return np.asarray(inertia + own + gravity + friction)

    return predict


def ours(chain: Chain, log: Log) -> dict[str, Predictor]:
    """Our least squares, and the bodies that it finds."""
    found = aw.identify(chain, log)
    unknowns = Unknowns(chain, tuple(DRIVES))
    values = np.array([one.value for one in found.parameters])
    assert not found.not_excited, found.not_excited
    return {
        "armwright, least squares": lambda one: (
            unknowns.base.regressor(unknowns.regressor(one.q, one.qd, one.qdd)) @ values
        ),
        "armwright, bodies": lambda one: (
            aw.inverse_dynamics(found.robot, one.q, one.qd, one.qdd) + found.offsets
        ),
    }


def of_pinocchio(model: Any, train: Samples) -> Predictor:
    """Unweighted least squares of pinocchio's regressor with drives."""
    data = model.createData()

    def rows(one: Samples) -> Array:
        states = zip(one.q, one.qd, one.qdd, strict=True)
        bodies = [pin.computeJointTorqueRegressor(model, data, *state).copy() for state in states]
        drives = (one.qdd, one.qd, np.sign(one.qd), np.ones_like(one.q))
        return np.concatenate([bodies, *(d[..., None] * np.eye(7) for d in drives)], axis=-1)

    Y, tau = train.reduce(rows(train)), train.reduce(train.tau)
    values = np.linalg.lstsq(Y.reshape(-1, Y.shape[-1]), tau.ravel(), rcond=1e-8)[0]
    return lambda one: np.asarray(rows(one) @ values)


def of_figaroh(model: Any, train: Samples) -> Predictor:
    """Base parameters of figaroh's regressor and QR decompositions; joint by joint are its rows."""
    from figaroh.tools import qrdecomposition, regressor  # noqa: PLC0415

    robot = type("Robot", (), {"model": model, "data": model.createData()})()
    config = {"has_friction": True, "has_actuator_inertia": True, "has_joint_offset": True,
              "is_joint_torques": True, "act_idxv": list(range(7))}  # fmt: skip

    def rows(one: Samples) -> Array:
        W = regressor.build_regressor_basic(robot, one.q, one.qd, one.qdd, config)
        return np.moveaxis(W.reshape(7, len(one.q), -1), 0, 1)

    Y, tau = train.reduce(rows(train)), train.reduce(train.tau)
    W = Y.reshape(-1, Y.shape[-1])
    names = {str(i): 0.0 for i in range(W.shape[1])}
    unused, left = regressor.get_index_eliminate(W, names)
    reduced = regressor.build_regressor_reduced(W, unused)
    base = [int(left[i]) for i in qrdecomposition.get_baseIndex(reduced, left)]
    values = np.linalg.lstsq(W[:, base], tau.ravel(), rcond=None)[0]
    return lambda one: np.asarray(rows(one)[..., base] @ values)


def main() -> None:
    """Print what is left of the torques of the rest of the log, joint by joint."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--share", type=float, default=0.7)
    given = parser.parse_args()
    chain = aw.load_robot("panda").chain
    names = ("positions", "torques")
    q, tau = (np.loadtxt(f"{given.folder / LOGS}{name}.txt").reshape(-1, 7) for name in names)
    times = np.loadtxt(f"{given.folder / LOGS}time.txt")
    split = int(given.share * len(q))
    log = Log(q[:split], tau[:split], times[:split])
    train, rest = (read_log(chain, Log(q[part], tau[part], times[part]))
                   for part in (slice(0, split), slice(split, None)))  # fmt: skip
    model = pin.buildReducedModel(
        full := pin.buildModelFromXML(builtin_urdf("panda")), list(range(8, full.njoints)),
        pin.neutral(full),
    )  # fmt: skip
    makers: dict[str, Callable[[], dict[str, Predictor]]] = {
        "description": lambda: {
            "description": lambda one: aw.inverse_dynamics(chain, one.q, one.qd, one.qdd)
        },
        "published": lambda: {"published": published(given.folder)},
        "armwright": lambda: ours(chain, log),
        "pinocchio": lambda: {"pinocchio, lstsq": of_pinocchio(model, train)},
        "figaroh": lambda: {"figaroh, QR": of_figaroh(model, train)},
    }
    torque = np.sqrt(np.mean(rest.reduce(rest.tau) ** 2, axis=0))
    print(f"{'torques [N m]':28}", *(f"{value:7.3f}" for value in torque))
    for make in makers.values():
        start = time.process_time()
        try:
            predictors = make()
        except ImportError as error:
            print(f"{error.name} is not installed")
            continue
        took = time.process_time() - start
        for name, predict in predictors.items():
            left = np.sqrt(np.mean(rest.reduce(rest.tau - predict(rest)) ** 2, axis=0))
            print(f"{name:28}", *(f"{value:7.3f}" for value in left), f"  {took:.1f} s")


if __name__ == "__main__":
    main()
