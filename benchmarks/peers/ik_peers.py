"""Peers of inverse kinematics, in an interpreter of their own: ``python ik_peers.py case.npz``.

It needs numpy and whichever peers are there; those that are not are left out and said so. The case
holds poses, starts, limits, the chain's offsets and its URDF; the answer is written beside it.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
TOLERANCE = 1e-6


def time_calls(solve: Callable[[int], Any], count: int) -> tuple[list[Any], Array]:
    """Answers of a number of calls and what each took [us]."""
    solve(0)
    answers, spent = [], np.empty(count)
    for k in range(count):
        start = time.perf_counter()
        answer = solve(k)
        spent[k] = 1e6 * (time.perf_counter() - start)
        answers.append(answer)
    return answers, spent


def trac_ik(case: Any) -> Callable[[int], Any]:
    """TRAC-IK as pytracik has it, 100 ms a call at most."""
    pytracik = import_module("pytracik")
    tip, base = str(case["tip"]), str(case["base"])
    solver = pytracik.TRAC_IK(
        base, tip, str(case["urdf"]), 0.1, TOLERANCE, pytracik.SolveType.Speed
    )
    poses, quaternions, starts = case["poses"], case["quaternions"], case["starts"]
    arguments = [
        (starts[k], *map(float, poses[k, :3, 3]), *map(float, quaternions[k]))
        for k in range(len(poses))
    ]

    def solve(k: int) -> Any:
        answer = pytracik.ik(solver, *arguments[k])
        return answer[1:] if answer[0] >= 0 else []

    return solve


def toolbox(case: Any) -> Callable[[int], Any]:
    """The C++ ik_LM of roboticstoolbox, Chan's method, with joint limits."""
    toolbox_package = import_module("roboticstoolbox")
    ET, ETS = toolbox_package.ET, toolbox_package.ETS
    SE3 = import_module("spatialmath").SE3
    parts = []
    for j, offset in enumerate(case["offsets"]):
        parts.append(ET.SE3(SE3(offset, check=False)))
        limits = [case["lower"][j], case["upper"][j]]
        parts.append(
            ET.Rz(jindex=j, qlim=limits) if case["types"][j] == 0 else ET.tz(jindex=j, qlim=limits)
        )
    parts.append(ET.SE3(SE3(case["tip_offset"], check=False)))
    arm = ETS(parts)
    # Its tolerance is on half the squared error.
    tolerance = 0.5 * TOLERANCE**2
    mask = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 1.0]) if len(case["lower"]) < 6 else None
    poses, starts = case["poses"], case["starts"]

    def solve(k: int) -> Any:
        found = arm.ik_LM(
            poses[k], q0=starts[k], tol=tolerance, slimit=500, joint_limits=True, mask=mask, k=1.0
        )
        return found.q if found.success else []

    return solve


def _lines(case: Any) -> tuple[Array, Array, Array]:
    """Axes, the offsets between them and the tip's rotation, all at q = 0."""
    T, axes, points = np.eye(4), [], [np.zeros(3)]
    for offset in case["offsets"]:
        T = T @ offset
        axes.append(T[:3, 2])
        points.append(T[:3, 3])
    T = T @ case["tip_offset"]
    points.append(T[:3, 3])
    return np.array(axes), np.diff(np.array(points), axis=0), T[:3, :3]


def eaik(case: Any) -> Callable[[int], Any]:
    """All branches of EAIK; of seven joints the last is held, which costs it no more than six."""
    H, P, home = _lines(case)
    held = [(6, float(case["starts"][0, 6]))] if len(H) == 7 else []
    robot = import_module("eaik.IK_HP").HPRobot(H, P, fixed_axes=held)
    if not robot.hasKnownDecomposition():
        raise RuntimeError("finds no decomposition")
    poses = np.array(case["poses"])
    poses[:, :3, :3] = poses[:, :3, :3] @ home.T
    return lambda k: robot.IK(poses[k]).Q


def ik_geo(case: Any) -> Callable[[int], Any]:
    """All branches of ik-geo."""
    Robot = import_module("ik_geo").Robot
    H, P, home = _lines(case)
    # The last axes meet, three or two of them: their common point is where it expects them to.
    if str(case["kind"]) == "spherical":
        robot = Robot.spherical_two_parallel(H.tolist(), _meet(H, P, 3).tolist())
    else:
        robot = Robot.three_parallel_two_intersecting(H.tolist(), _meet(H, P, 4).tolist())
    # It takes rotations column by column.
    turns = np.ascontiguousarray(np.swapaxes(np.array(case["poses"])[:, :3, :3] @ home.T, 1, 2))
    places = np.ascontiguousarray(case["poses"][:, :3, 3])

    def solve(k: int) -> Any:
        return [q for q, least in robot.get_ik(turns[k], places[k]) if not least]

    return solve


def _meet(H: Array, P: Array, first: int) -> Array:
    """Offsets with the origins of the axes from ``first`` on where they meet."""
    points = np.cumsum(P, axis=0)
    across = np.eye(3) - H[first:, :, None] * H[first:, None, :]
    known = np.einsum("kij,kj->i", across, points[first:6])
    points[first:6] = np.linalg.lstsq(across.sum(0), known, rcond=None)[0]
    return np.diff(np.vstack([np.zeros(3), points]), axis=0)


PEERS = {"TRAC-IK": trac_ik, "toolbox ik_LM": toolbox, "EAIK": eaik, "ik-geo": ik_geo}


def main() -> None:
    """Solve the case of argument 1 by the peers of argument 2 on."""
    path = Path(sys.argv[1])
    case = np.load(path, allow_pickle=False)
    told: dict[str, Any] = {}
    for name in sys.argv[2:]:
        try:
            solve = PEERS[name](case)
            answers, spent = time_calls(solve, len(case["poses"]))
        except Exception as error:  # noqa: BLE001  a peer that is not there is left out
            told[f"{name}: missing"] = f"{type(error).__name__}: {error}"
            continue
        rows = [np.atleast_2d(np.array(answer, dtype=float)) for answer in answers]
        n = len(case["lower"])
        rows = [row.reshape(-1, n) if row.size else np.empty((0, n)) for row in rows]
        told[f"{name}: spent"] = spent
        told[f"{name}: counts"] = np.array([len(row) for row in rows])
        told[f"{name}: joints"] = np.concatenate(rows) if rows else np.empty((0, n))
    with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".npz", delete=False) as file:
        np.savez(file, **told)
    Path(file.name).rename(path.with_suffix(".answers.npz"))


if __name__ == "__main__":
    main()
