"""Is the same request answered with the same bytes, again and again and in fresh processes?"""

import hashlib
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.mbm_problems import Case, cases, panda
from obstacles.robot_geometry import RobotGeometry
from planning.options import Options
from planning.pipeline import plan
from planning.result import Failure

#: Problems compared, spread over all that were chosen.
_PROBLEMS = 20
#: Fresh processes started.
_PROCESSES = 2
#: No deadline may cut a stage short: that is the one thing that time may change [s].
_TIMEOUT = 60.0


def digest(case: Case, robot: RobotGeometry) -> str:
    """Hash of the path, the motion and the proof of a problem's answer."""
    answer = plan(case.problem(robot, 0.0), Options(timeout=_TIMEOUT))
    if isinstance(answer, Failure):
        return answer.code
    bytes_of = hashlib.sha256(answer.path.waypoints.tobytes())
    bytes_of.update(answer.trajectory.breaks.tobytes() + answer.trajectory.coefficients.tobytes())
    proof = answer.certificate
    bytes_of.update(repr((answer.planner, proof.min_clearance, proof.clearance_pair)).encode())
    return bytes_of.hexdigest()


def compare(folder: Path, robot: RobotGeometry, chosen: Sequence[Case], repeats: int) -> None:
    """Print how many problems got the same answer every time."""
    spread = chosen[:: max(1, len(chosen) // _PROBLEMS)][:_PROBLEMS]
    first = {case.name: digest(case, robot) for case in spread}
    other = {
        case.name
        for _ in range(repeats - 1)
        for case in spread
        if digest(case, robot) != first[case.name]
    }
    for _ in range(_PROCESSES):
        command = [sys.executable, "-m", "benchmarks.mbm_repeats", str(folder), *first]
        lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        told = dict(line.split() for line in lines.splitlines())
        other |= {name for name, known in first.items() if told.get(name) != known}
    print(
        f"{len(spread) - len(other)} of {len(spread)} problems answered with the same bytes"
        f" {repeats} times here and in {_PROCESSES} fresh processes {sorted(other)}"
    )


def main() -> None:
    """Print the digests of the problems that are named, one a line, in a process of their own."""
    folder, wanted = Path(sys.argv[1]), set(sys.argv[2:])
    robot = panda(folder.parent.parent / "panda")
    for case in cases(folder, robot.chain.joint_names, 1):
        if case.name in wanted:
            print(case.name, digest(case, robot))


if __name__ == "__main__":
    main()
