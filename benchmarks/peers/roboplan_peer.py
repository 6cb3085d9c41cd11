"""RoboPlan on what ``benchmarks.peers --roboplan`` writes, in an environment of its own.

    python3 -m venv PEER; PEER/bin/pip install roboplan trimesh scipy pyyaml pillow
    PEER/bin/python benchmarks/peers/roboplan_peer.py problems.json path/to/panda answers.json

It imports nothing of Armwright. Links are the convex hulls of their meshes, as they are for the
judge. RRT-Connect with RoboPlan's default steps and as many nodes as the time allows, then its own
shortcuts. Where it gives up before the time is over, it begins anew with the next seed.
"""

# mypy: ignore-errors

import json
import sys
import tempfile
import time
from itertools import combinations
from pathlib import Path

import numpy as np
import trimesh
import yaml
from roboplan import core, rrt, toppra
from scipy.spatial.transform import Rotation

GROUP = "panda_arm"
#: Nodes of its trees: more than any of these problems needs in the time.
NODES = 100_000


def hulls(source: Path, target: Path) -> Path:
    """The robot's folder again, its meshes replaced by their convex hulls."""
    (target / "meshes" / "collision").mkdir(parents=True)
    for path in sorted((source / "meshes" / "collision").glob("*.obj")):
        hull = trimesh.load(path, force="mesh").convex_hull
        hull.export(target / "meshes" / "collision" / path.name)
    for name in ("panda.urdf", "panda.srdf"):
        (target / name).write_text((source / name).read_text())
    return target


def obstacles(text: str) -> list:
    """The boxes and cylinders of a MoveIt scene, with their poses (4, 4)."""
    found = []
    for entry in yaml.safe_load(text)["world"]["collision_objects"]:
        for shape, at in zip(entry["primitives"], entry["primitive_poses"], strict=True):
            d = shape["dimensions"]
            solid = core.Box(*d) if shape["type"] == "box" else core.Cylinder(d[1], d[0])
            pose = np.eye(4, order="F")
            pose[:3, :3] = Rotation.from_quat(at["orientation"]).as_matrix()
            pose[:3, 3] = at["position"]
            found.append((solid, pose))
    return found


def with_accelerations(scene: core.Scene, names: list, limits: list) -> None:
    """Give joints their limits of acceleration."""
    rows = {
        name: {"has_acceleration_limits": True, "max_acceleration": [most]}
        for name, most in zip(names, limits, strict=True)
    }
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
        yaml.safe_dump({"joint_limits": rows}, file)
        file.flush()
        scene.importJointLimitsFromConfig(core.loadJointLimitsConfig(file.name))


def timed(scene: core.Scene, path: core.JointPath) -> float:
    """Duration of the motion along a path by its own toppra, splines checked for collisions [s]."""
    options = toppra.TOPPRAOptions(dt=0.01, mode=toppra.SplineFittingMode.Adaptive)
    motion = toppra.PathParameterizerTOPPRA(scene, GROUP).generate(path, options)
    return float(motion.times[-1])


def solve(scene: core.Scene, case: dict, names: list, timeout: float) -> core.JointPath | None:
    """The shortened path of one problem; None where there is none in the time."""
    start, goal = (core.JointConfiguration(names, np.array(case[end])) for end in ("start", "goal"))
    began, seed = time.process_time(), 0
    while (left := timeout - (time.process_time() - began)) > 0.0:
        options = rrt.RRTOptions(
            group_name=GROUP, rrt_connect=True, max_nodes=NODES, max_planning_time=left
        )
        planner = rrt.RRT(scene, options)
        planner.setRngSeed(seed)
        seed += 1
        try:
            path = planner.plan(start, goal)
        except RuntimeError:
            continue
        shortcuts = core.PathShortcutter(scene, core.PathShortcuttingOptions(group_name=GROUP))
        return shortcuts.shortcut(path)
    return None


def main() -> None:
    """Solve every problem and write paths and processor times."""
    asked = json.loads(Path(sys.argv[1]).read_text())
    with tempfile.TemporaryDirectory() as folder:
        robot = hulls(Path(sys.argv[2]), Path(folder, "panda"))
        scene = core.Scene("panda", core.loadUrdfSceneDescription(robot / "panda.urdf", [robot]))
    scene.importSrdf((Path(sys.argv[2]) / "panda.srdf").read_text())
    names = [f"panda_joint{k}" for k in range(1, 8)]
    with_accelerations(scene, names, asked["acceleration"])
    grey, answers = np.array([0.5, 0.5, 0.5, 1.0]), []
    for case in asked["cases"]:
        things = obstacles(case["scene"])
        for k, (solid, pose) in enumerate(things):
            add = scene.addBoxGeometry if isinstance(solid, core.Box) else scene.addCylinderGeometry
            add(f"thing_{k}", "universe", solid, pose, grey)
        # Obstacles stand on each other; it would take that for a collision.
        ids = [f"thing_{k}" for k in range(len(things))]
        if len(ids) > 1:
            scene.setCollisions(list(combinations(ids, 2)), False)
        began = time.process_time()
        path = solve(scene, case, names, asked["timeout"])
        answers.append({"ms": 1e3 * (time.process_time() - began), "path": None})
        if path is not None:
            rows = [np.asarray(q).tolist() for q in path.positions]
            answers[-1] |= {"path": rows, "duration": timed(scene, path)}
        for name in ids:
            scene.removeGeometry(name)
    Path(sys.argv[3]).write_text(json.dumps(answers))


if __name__ == "__main__":
    main()
