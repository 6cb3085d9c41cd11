"""MPLib on the problems that ``benchmarks.peers --mplib`` writes, in an environment of its own.

    python3 -m venv PEER; PEER/bin/pip install mplib trimesh scipy pyyaml
    PEER/bin/python benchmarks/peers/mplib_peer.py problems.json path/to/panda answers.json

It imports nothing of Armwright. Links are the convex hulls of their meshes, as they are for the
judge; range and simplification are MPLib's defaults.
"""

# mypy: ignore-errors

import json
import sys
import tempfile
import time
from pathlib import Path

import mplib
import numpy as np
import trimesh
import yaml
from mplib.collision_detection import fcl

#: MPLib's default step of its RRT-Connect [rad].
RANGE = 0.1


def hulls(source: Path, target: Path) -> Path:
    """The robot's folder again, every collision mesh replaced by its convex hull."""
    for path in sorted((source / "meshes" / "collision").glob("*.obj")):
        hull = trimesh.load(path, force="mesh").convex_hull
        (target / "meshes" / "collision").mkdir(parents=True, exist_ok=True)
        # MPLib looks for a convex mesh under the name with this ending.
        for name in (path.name, path.name + ".convex.stl"):
            hull.export(target / "meshes" / "collision" / name)
    (target / "panda.srdf").write_text((source / "panda.srdf").read_text())
    urdf = (source / "panda.urdf").read_text()
    (target / "panda.urdf").write_text(urdf)
    return target


def pose(position, orientation) -> mplib.Pose:
    """MPLib's pose, its quaternion starting with w."""
    x, y, z, w = orientation
    return mplib.Pose(np.array(position, dtype=float), np.array([w, x, y, z], dtype=float))


def obstacles(text: str) -> list:
    """The boxes and cylinders of a MoveIt scene."""
    found = []
    for entry in yaml.safe_load(text)["world"]["collision_objects"]:
        for k, (shape, at) in enumerate(
            zip(entry["primitives"], entry["primitive_poses"], strict=True)
        ):
            d = shape["dimensions"]
            solid = fcl.Box(*d) if shape["type"] == "box" else fcl.Cylinder(d[1], d[0])
            found.append(
                fcl.FCLObject(
                    f"{entry['id']}_{k}",
                    mplib.Pose(),
                    [fcl.CollisionObject(solid)],
                    [pose(at["position"], at["orientation"])],
                )
            )
    return found


def main() -> None:
    """Solve every problem and write paths and processor times."""
    asked = json.loads(Path(sys.argv[1]).read_text())
    with tempfile.TemporaryDirectory() as folder:
        robot = hulls(Path(sys.argv[2]), Path(folder))
        planner = mplib.Planner(
            urdf=robot / "panda.urdf",
            srdf=robot / "panda.srdf",
            move_group="panda_link8",
            use_convex=True,
        )
    mplib.set_global_seed(1)
    answers = []
    for case in asked["cases"]:
        things = obstacles(case["scene"])
        for thing in things:
            planner.planning_world.add_object(thing)
        began = time.process_time()
        status, path = planner.planner.plan(
            np.array(case["start"]),
            [np.array(case["goal"])],
            time=asked["timeout"],
            range=RANGE,
            simplify=True,
        )
        spent = 1e3 * (time.process_time() - began)
        solved = status == "Exact solution"
        answers.append({"ms": spent, "path": np.array(path).tolist() if solved else None})
        if solved and len(path) > 1:
            # A spline through the waypoints, timed by toppra; nothing looks at its collisions.
            planner.joint_vel_limits = np.array(asked["velocity"])
            planner.joint_acc_limits = np.array(asked["acceleration"])
            answers[-1]["duration"] = float(planner.TOPP(np.array(path), step=0.01)[4])
        for thing in things:
            planner.planning_world.remove_object(thing.name)
    Path(sys.argv[3]).write_text(json.dumps(answers))


if __name__ == "__main__":
    main()
