"""sscbirrt on what ``benchmarks.peers --sscbirrt`` writes, in an environment of its own.

    python3 -m venv PEER; PEER/bin/pip install "sscbirrt[mujoco]==3.15.0" scipy pyyaml
    PEER/bin/python benchmarks/peers/sscbirrt_peer.py problems.json path/to/panda answers.json

It imports nothing of Armwright. Solids are MuJoCo's: hulls of the links' meshes. The search, the
shortcuts in length and those in time, which follow them, are as sscbirrt has them by default; its
motions have bounded velocity and acceleration, their jerk is not bounded.
"""

# mypy: ignore-errors

import json
import re
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import yaml
from sscbirrt import CBiRRTConfig, TrajectoryOptions
from sscbirrt.mujoco import Arm, plan


def world(folder: Path, text: str) -> mujoco.MjModel:
    """The robot among the boxes and cylinders of a MoveIt scene."""
    urdf = re.sub(r"package://", f"{folder.resolve()}/", (folder / "panda.urdf").read_text())
    urdf = re.sub(r"<visual>.*?</visual>", "", urdf, flags=re.DOTALL)
    options = '<mujoco><compiler strippath="false" fusestatic="false"/></mujoco>'
    spec = mujoco.MjSpec.from_string(re.sub(r"(<robot[^>]*>)", r"\1" + options, urdf, count=1))
    bodies = {body.name for body in spec.bodies}
    pairs = ElementTree.parse(folder / "panda.srdf").getroot().findall("disable_collisions")
    for pair in pairs:
        if {pair.attrib["link1"], pair.attrib["link2"]} <= bodies:
            spec.add_exclude(bodyname1=pair.attrib["link1"], bodyname2=pair.attrib["link2"])
    spec.body("panda_link8").add_site(name="tool")
    for entry in yaml.safe_load(text)["world"]["collision_objects"]:
        for shape, at in zip(entry["primitives"], entry["primitive_poses"], strict=True):
            d, (x, y, z, w), box = shape["dimensions"], at["orientation"], shape["type"] == "box"
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX if box else mujoco.mjtGeom.mjGEOM_CYLINDER,
                size=[d[0] / 2, d[1] / 2, d[2] / 2] if box else [d[1], d[0] / 2, 0.0],
                pos=at["position"], quat=[w, x, y, z],
            )  # fmt: skip
    return spec.compile()


def polynomials(motion) -> tuple[np.ndarray, np.ndarray]:
    """Breaks and coefficients, shape (m, n, 3), of a motion of ramps."""
    starts = motion.breaks
    inner = [
        start + np.cumsum([length for length, _ in ramp.pieces])
        for start, piece in zip(starts, motion.pieces, strict=False)
        for ramp in piece.ramps
    ]
    breaks = np.unique(np.concatenate([starts, *inner]).clip(0.0, starts[-1]))
    breaks = breaks[np.concatenate([[True], np.diff(breaks) > 1e-9])]
    q, v, _ = motion.evaluate(breaks)
    halves = 0.5 * np.diff(v, axis=0) / np.diff(breaks)[:, None]
    return breaks, np.stack([q[:-1], v[:-1], halves], axis=-1)


def main() -> None:
    """Solve every problem and write paths, motions and processor times."""
    asked = json.loads(Path(sys.argv[1]).read_text())
    names = [f"panda_joint{k}" for k in range(1, 8)]
    limits = TrajectoryOptions(asked["velocity"], asked["acceleration"])
    answers = []
    for case in asked["cases"]:
        model = world(Path(sys.argv[2]), case["scene"])
        data, arm = mujoco.MjData(model), Arm(model, names, "tool")
        data.qpos[: len(names)] = case["start"]
        began, found = time.process_time(), None
        try:
            found = plan(
                model, data, arm, goal=np.array(case["goal"]), seed=0, trajectory=limits,
                config=CBiRRTConfig(timeout=asked["timeout"]),
            )  # fmt: skip
        except Exception as error:  # noqa: BLE001 (it raises where an end is not free for it)
            print(f"{type(error).__name__}: {str(error)[:120]}")
        answer = {"ms": 1e3 * (time.process_time() - began), "path": None}
        if found is not None and found.success:
            breaks, coefficients = polynomials(found.trajectory)
            answer["path"] = np.array(found.path).tolist()
            answer |= {"breaks": breaks.tolist(), "coefficients": coefficients.tolist()}
            answer["duration"] = found.trajectory.duration
        answers.append(answer)
    Path(sys.argv[3]).write_text(json.dumps(answers))


if __name__ == "__main__":
    main()
