"""States, edges and plans of a URDF with meshes: ``python -m benchmarks.mesh_descriptions``.

    python -m benchmarks.mesh_descriptions irb1600_6_12.urdf m20ia.urdf [--coarse]

The URDFs lie in the packages that their meshes are named by, as in ROS-Industrial's repositories:
``abb_irb1600_support/urdf/irb1600_6_12.urdf`` of ros-industrial/abb_experimental, commit c8488c2,
and ``fanuc_m20ia_support/urdf/m20ia.urdf`` of ros-industrial/fanuc, commit 62abfd8; later commits
have xacro in their place. They are uploaded as they lie, accelerations are ten times the speeds.
States are random, edges are 0.5 rad long and begin at free states, both in scenes of our own.
With ``--coarse`` no solid is cut more finely because it is crowded, and no hull of many corners is
taken for a piece. All times are processor time.
"""

import argparse
import base64
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.arms import configurations, free_ends
from benchmarks.mesh_plans import note_stages
from benchmarks.mesh_scenes import own_scenes, reach_of
from kinematics.description import MeshGeometry
from kinematics.forward import link_poses
from kinematics.urdf import parse_urdf
from obstacles import decomposition, robot_geometry
from obstacles.checker import Checker
from obstacles.robot_geometry import RobotGeometry
from planning.options import Options
from planning.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Plan
from service.schemas.robot import RobotBody
from service.translate.robots import robot as uploaded

Array = NDArray[np.float64]

#: Scenes, and in each of them random states, edges, and rounds of which the fastest counts.
SCENES, STATES, EDGES, ROUNDS = 12, 400, 40, 3
#: Length of an edge [rad].
LENGTH = 0.5
#: Corners that a hull has at most which is taken for a piece with --coarse.
FEW_CORNERS = 192


def request(urdf: Path) -> RobotBody:
    """The upload of a URDF with its meshes, from the package that it lies in."""
    text = urdf.read_text()
    packages = urdf.resolve().parents[2]
    links = parse_urdf(text).links.values()
    solids = [element.geometry for link in links for element in link.collisions]
    uris = {solid.uri for solid in solids if isinstance(solid, MeshGeometry)}
    files = {uri: packages / uri.removeprefix("package://") for uri in uris}
    return RobotBody.model_validate(
        {
            "name": "arm",
            "urdf": text,
            "default_limits": {"acceleration": "10 x velocity"},
            "meshes": {k: base64.b64encode(f.read_bytes()).decode() for k, f in files.items()},
        }
    )


def fastest(checker: Checker, states: Array, ends: Array) -> tuple[float, float]:
    """Least processor time of verdicts on states, and on edges from the first of them [s]."""
    spent = [np.inf, np.inf]
    for _ in range(ROUNDS):
        began = time.process_time()
        for q in states:
            checker.valid(q)
        middle = time.process_time()
        for a, b in zip(states, ends, strict=False):
            checker.free(a, b)
        spent = [min(spent[0], middle - began), min(spent[1], time.process_time() - middle)]
    return spent[0], spent[1]


def costs(robot: RobotGeometry) -> None:
    """Measure states, edges and plans, and tell."""
    random = np.random.default_rng(0)
    drawn = configurations(robot, random)
    tips = [link_poses(robot.chain, next(drawn), [robot.chain.tip_link])[0] for _ in range(100)]
    reach = reach_of(np.array([T[:3, 3] for T in tips]))
    of_states, of_edges = list[float](), list[float]()
    times, stages, tried = list[float](), dict[str, list[float]](), 0
    low, high = robot.chain.limits.lower, robot.chain.limits.upper
    for scene in own_scenes(SCENES, reach):
        checker = Checker.of(robot, scene)
        states = np.array([next(drawn) for _ in range(STATES)])
        free = states[checker.each_valid(states)][:EDGES]
        steps = random.normal(size=free.shape)
        ends = free + LENGTH * steps / np.linalg.norm(steps, axis=1)[:, None]
        of_states.append(fastest(checker, states, ends[:0])[0] / STATES)
        of_edges.append(fastest(checker, free, np.clip(ends, low, high))[1] / max(len(free), 1))
        found = free_ends(checker, drawn)
        for start, goal in zip(found[::2], found[1::2], strict=False):
            tried += 1
            began = time.process_time()
            answer = plan(Problem(robot, scene, start, (JointGoal(goal),)), Options())
            if isinstance(answer, Plan):
                times.append(1e3 * (time.process_time() - began))
                note_stages(stages, answer)
    print(f"  a state {1e6 * np.mean(of_states):.1f} us, an edge {1e6 * np.mean(of_edges):.0f} us")
    for name, spent in {f"{len(times)} of {tried} plans": times, **stages}.items():
        middle, most, worst = np.percentile(spent, [50, 95, 100])
        print(f"  {name:16} ms: median {middle:.1f}, 95 % {most:.1f}, most {worst:.0f}", flush=True)


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("urdfs", type=Path, nargs="+")
    parser.add_argument("--coarse", action="store_true", help="cut as if no solid were crowded")
    given = parser.parse_args()
    if given.coarse:
        vars(decomposition)["_EXACT_CORNERS"] = FEW_CORNERS
        vars(robot_geometry)["crowded_solids"] = lambda _: set()
    for urdf in given.urdfs:
        began = time.process_time()
        robot, _ = uploaded(request(urdf))
        covers = sum(piece.surface is not None for piece in robot.pieces)
        took = time.process_time() - began
        print(f"{urdf.name}: {len(robot.pieces)} pieces, {covers} of them covers, in {took:.1f} s")
        costs(robot)


if __name__ == "__main__":
    main()
