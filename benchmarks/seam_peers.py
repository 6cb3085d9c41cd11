"""Peers of the seams: they sample, and prove nothing. What they find is judged between waypoints.

- ``cpp_flow``: as CppFlow goes about it ("CppFlow: Generative Inverse Kinematics for Efficient and
  Robust Cartesian Path Planning"): 175 samples of every waypoint, each with the same latent values
  all along, of which dynamic programming takes the way with the least largest step of a joint. The
  samples are ours: every branch of the closed form at drawn spins, arm angles and places of a rail,
  where CppFlow has a network whose samples it must polish. It finds a way where no joint steps by
  more than 7 degrees or 2 cm, as published.
- ``ladder``: a graph as Descartes has it, on our search: every waypoint a layer, the spin sampled
  every 15 degrees, neighbours within 0.3 rad.
- ``descartes``: tesseract's own, see ``benchmarks/seam_descartes.py``.

Joints go straight between waypoints, at the tool's speed. A way is unclean where the tool leaves
the seam by more than 0.1 mm or its tilt, where anything touches, or a joint would be too fast.
"""

import json
import subprocess
import tempfile
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pinocchio

from benchmarks.fcl_judge import FclJudge
from benchmarks.seam_arms import SPEED, STARTS, Arm
from kinematics.arrays import Array
from kinematics.ik.analytic import branches
from kinematics.pose import rotation_z, transform
from kinematics.robots import builtin_chain
from obstacles.checker import Checker
from obstacles.scene import Scene
from obstacles.shapes import Cylinder
from planning.cartesian.seam_path import seam_places, seam_runs
from planning.cartesian.seam_search import SeamSearch
from planning.deadline import Deadline
from planning.seam_options import SeamOptions
from planning.tool_tolerance import ToolTolerance

#: Deviation that is allowed beyond the tolerance [m], [rad].
POSITION, ORIENTATION = 1e-4, 1e-3
#: Samples of a waypoint, and the branches that a draw gives at most.
_SAMPLES, _BRANCHES = 175, 8
#: Largest steps between waypoints [rad], [m].
_TURN, _SLIDE = np.radians(7.0), 0.02
#: Instants between waypoints that the judge looks at.
_BETWEEN = 3
#: Tesseract's solver for an arm, and what it is told of it.
CLOSED_FORMS = {
    "kr6_sixx": (
        "OPWInvKin",
        (
            "{base_link: base_link, tip_link: tool0, params: {a1: 0.025, a2: -0.035, b: 0.0, "
            "c1: 0.4, c2: 0.455, c3: 0.42, c4: 0.08, "
            "offsets: [0, -1.5707963267948966, 0, 0, 0, 0], "
            "sign_corrections: [-1, 1, 1, -1, 1, -1]}}"
        ),
    ),
    # It counts from the base frame of ROS, half a turn from that of the controller.
    "ur5e": ("URInvKin", "{base_link: turned, tip_link: tool0, model: UR5e}"),
}
_TURNED = """<link name="turned"/><joint name="half_turn" type="fixed"><parent link="turned"/>
<child link="base"/><origin rpy="0 0 3.141592653589793"/></joint></robot>"""
_POST = """<link name="post"><collision><geometry><cylinder radius="{radius}" length="{height}"/>
</geometry></collision></link><joint name="post_joint" type="fixed"><parent link="{base}"/>
<child link="post"/><origin xyz="{place}"/></joint></robot>"""


def measure(name: str, arm: Arm, scene: Scene, seams: list[SeamOptions]) -> None:
    """Print what the peers find that run in this process."""
    random, flow, rungs = np.random.default_rng(0), [], []
    for asked in seams:
        poses = np.array([point.T_base_tip for point in asked.waypoints])
        began = time.process_time()
        flow.append((cpp_flow(name, arm, scene, poses, random), time.process_time() - began))
        began = time.process_time()
        solved = ladder(arm, scene, asked, np.array(STARTS[name]))
        rungs.append((solved, time.process_time() - began))
    _tell("CppFlow-like", arm, scene, seams, flow)
    found = sum(solved for solved, _ in rungs)
    print(f"  ladder: {found} of {len(seams)}, median {_median(rungs):.0f} ms of processor time")


def measure_descartes(
    python: Path, name: str, arm: Arm, scene: Scene, seams: list[SeamOptions]
) -> None:
    """Print what tesseract's Descartes finds, in another interpreter."""
    poses = [[point.T_base_tip.tolist() for point in asked.waypoints] for asked in seams]
    solver, config = CLOSED_FORMS[name]
    (post,) = scene.obstacles
    assert isinstance(post.shape, Cylinder)
    chain, links, own = arm.robot.chain, arm.robot.links, arm.robot.self_pairs
    size = {"radius": post.shape.radius, "height": post.shape.height}
    place = " ".join(map(str, post.T_world_obstacle[:3, 3]))
    urdf = arm.urdf.replace("</robot>", _POST.format(base=chain.root_link, place=place, **size))
    apart = {tuple(sorted((links[i], links[j]))) for i, j in own}
    names = sorted(set(links))
    allowed = [(a, b) for a in names for b in names if a < b and (a, b) not in apart]
    if name == "ur5e":
        urdf = urdf.replace("</robot>", _TURNED)
    case = {
        "arm": {
            "name": name, "urdf": urdf, "base": chain.base_link, "tip": chain.tip_link,
            "solver": solver, "config": config, "allowed": allowed,
        },
        "seams": poses,
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        asked, answered = Path(folder) / "seams.json", Path(folder) / "ways.json"
        asked.write_text(json.dumps(case))
        script = Path(__file__).with_name("seam_descartes.py")
        subprocess.run([python, script, asked, answered], check=True, stdout=subprocess.DEVNULL)
        ways = json.loads(answered.read_text())
    found = [(np.array(way) if way else None, seconds) for way, seconds in ways]
    _tell("Descartes", arm, scene, seams, found)


def _tell(
    peer: str, arm: Arm, scene: Scene, seams: list[SeamOptions],
    found: list[tuple[Array | None, float]],
) -> None:  # fmt: skip
    ways = [(asked, way) for asked, (way, _) in zip(seams, found, strict=True) if way is not None]
    faults = [_faults(arm, scene, asked, way) for asked, way in ways]
    kinds = {kind: sum(kind in one for one in faults) for kind in ("off", "touching", "too fast")}
    print(
        f"  {peer}: {len(ways)} of {len(seams)}, unclean {sum(map(bool, faults))} {kinds}, "
        f"median {_median(found):.0f} ms of processor time"
    )


def _median(found: list[tuple[Array | None, float]] | list[tuple[bool, float]]) -> float:
    return 1e3 * float(np.median([seconds for _, seconds in found]))


def cpp_flow(
    name: str, arm: Arm, scene: Scene, poses: Array, random: np.random.Generator
) -> Array | None:
    """Configurations at poses (k, 4, 4) by dynamic programming over samples; None for no way."""
    layers = _samples(name, arm, poses, random)
    checker = Checker.of(arm.robot, scene)
    layers = [layer[checker.each_valid(layer)] if len(layer) else layer for layer in layers]
    if not all(len(layer) for layer in layers):
        return None
    allowed = np.where(arm.robot.chain.joint_types == 0, _TURN, _SLIDE)
    worst, sources = np.zeros(len(layers[0])), []
    for before, after in pairwise(layers):
        step = (np.abs(after[:, None] - before) / allowed).max(axis=2)
        through = np.maximum(step, worst)
        sources.append(through.argmin(axis=1))
        worst = through.min(axis=1)
    if worst.min() > 1.0:
        return None
    chosen = [int(worst.argmin())]
    for source in reversed(sources):
        chosen.append(int(source[chosen[-1]]))
    return np.array([layer[k] for layer, k in zip(layers, reversed(chosen), strict=True)])


def _samples(name: str, arm: Arm, poses: Array, random: np.random.Generator) -> list[Array]:
    """Configurations inside the limits at each pose, for the same drawn values all along."""
    draws = _SAMPLES // _BRANCHES + 1
    spins = random.uniform(-np.pi, np.pi, draws)
    turned = poses[:, None] @ np.array([transform(rotation_z(spin)) for spin in spins])
    chain, slides = arm.robot.chain, None
    low, high = chain.limits.lower, chain.limits.upper
    if name == "iiwa_rail":
        chain, slides = builtin_chain("iiwa14"), random.uniform(low[0], high[0], draws)
        turned[..., 1, 3] -= slides
    values = random.uniform(-np.pi, np.pi, draws)
    if name == "panda":
        values = random.uniform(low[-1], high[-1], draws)
    parameters = np.tile(values, len(poses))[:, None] if chain.n == 7 else None
    found = branches(chain, turned.reshape(-1, 4, 4), parameters=parameters, threads=1)
    assert found.counts is not None
    rows = np.arange(found.joints.shape[1])
    inside = (rows < found.counts[:, None]) & found.within_limits
    layers = []
    for k in range(len(poses)):
        part = slice(k * draws, (k + 1) * draws)
        q = found.joints[part][inside[part]]
        if slides is not None:
            place = np.repeat(slides, inside[part].sum(axis=1))
            q = np.column_stack([place, q])
        layers.append(np.ascontiguousarray(q))
    return layers


def ladder(arm: Arm, scene: Scene, asked: SeamOptions, start: Array) -> bool:
    """A ladder graph over every waypoint; whether there is a way.

    The spin is sampled, the tilt is not, and nothing is refined or proved.
    """
    exact = SeamOptions(asked.waypoints, ToolTolerance.of({}, ("rz",)), tool_speed=SPEED)
    places = seam_places(seam_runs(exact, 0.0))
    checker = Checker.of(arm.robot, scene)
    search = SeamSearch(checker, places, start, (SPEED,), Deadline.after(20.0))
    graph = search.prepare(places.layers(every=True))
    graph.jump = 0.3
    search.check_all(graph)
    search.solve(graph)
    first, last, _ = graph.longest()
    return last - first == len(places.s) - 1


def _faults(arm: Arm, scene: Scene, asked: SeamOptions, way: Array) -> set[str]:
    """Faults of a way (k, n) between and at waypoints."""
    fcl, faults = FclJudge(arm.robot, scene), set()
    p = np.array([point.T_base_tip for point in asked.waypoints])
    lengths = np.linalg.norm(np.diff(p[:, :3, 3], axis=0), axis=1)
    speeds = np.abs(np.diff(way, axis=0)) * (SPEED / lengths)[:, None]
    if (speeds > arm.robot.chain.limits.velocity).any():
        faults.add("too fast")
    for k in range(len(way) - 1):
        along = (p[k + 1] - p[k])[:3, 3]
        for s in np.arange(_BETWEEN) / _BETWEEN:
            q = way[k] + s * (way[k + 1] - way[k])
            pinocchio.framesForwardKinematics(arm.model, arm.data, q)
            T = arm.data.oMf[arm.frame]
            off = T.translation - p[k, :3, 3]
            off = off - np.clip(off @ along / (along @ along), 0.0, 1.0) * along
            axis = p[k, :3, 2] + s * (p[k + 1, :3, 2] - p[k, :3, 2])
            cosine = float(axis @ T.rotation[:, 2] / np.linalg.norm(axis))
            tilt = float(np.arccos(min(1.0, cosine)))
            if np.linalg.norm(off) > POSITION or tilt > asked.tolerance.tilt + ORIENTATION:
                faults.add("off")
            if fcl.collides(q):
                faults.add("touching")
    return faults
