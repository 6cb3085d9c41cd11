"""sscbirrt on the tasks that ``benchmarks.tasks --export`` writes, in an environment of its own.

    python3 -m venv PEER; PEER/bin/pip install "sscbirrt[mujoco,ssik]==3.15.0"
    PEER/bin/python -P benchmarks/peers_sscbirrt.py tasks.json

It imports nothing of Armwright. sscbirrt plans one motion to a set of goals; it has no stages. So
it gets the two free motions of each task, one after the other: from the start to 5 cm before any of
the 18 grasps, then, the object held as in the grasp that it chose, from 3 cm above where it stood
to 3 cm above any of the 12 places. Approaches, lifts and retreats are left out, and whether the two
motions join in one branch is not asked. Solids are MuJoCo's: hulls of the links' meshes.
"""

# mypy: ignore-errors

import json
import re
import sys
import tempfile
import time
from pathlib import Path

import mujoco
import numpy as np
from sscbirrt import CBiRRTConfig
from sscbirrt.mujoco import Arm, plan
from tsr import TSR

#: Longest time for one motion [s]; before a grasp and above a place [m].
TIMEOUT = 5.0
#: How often a task is begun anew, with another seed, where its second motion can't be done.
TRIES = 10
BEFORE, ABOVE = 0.05, 0.03


def main() -> None:
    """Measure."""
    case = json.loads(Path(sys.argv[1]).read_text())
    at_once, solved, times = 0, 0, []
    for task in case["tasks"]:
        world = World(case, task)
        began = time.process_time()
        for seed in range(TRIES):
            reason = world.solve(seed)
            if reason is None:
                at_once += seed == 0
                solved += 1
                times.append(time.process_time() - began)
                break
        seconds = time.process_time() - began
        print(task["name"], reason or "solved", f"{1e3 * seconds:.0f} ms", flush=True)
    print(
        f"sscbirrt: both motions of {at_once} of {len(case['tasks'])} tasks at the first try, of "
        f"{solved} within {TRIES}, processor time {1e3 * np.median(times):.0f} ms (median)"
    )


class World:
    """A robot with its hand among the solids of a task."""

    def __init__(self, case: dict, task: dict) -> None:
        self.task, self.joints = task, case["joints"]
        spec = mujoco.MjSpec.from_string(_urdf(case))
        for a, b in case["disabled"]:
            spec.add_exclude(bodyname1=a, bodyname2=b)
        mount = spec.body(case["mount"])
        mesh = spec.add_mesh(name="hand")
        mesh.file = case["hand"]
        mount.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH, meshname="hand",
            quat=[np.cos(case["turn"] / 2), 0.0, 0.0, np.sin(case["turn"] / 2)],
        )  # fmt: skip
        mount.add_site(name="tool")
        for solid in task["solids"]:
            body = spec.worldbody.add_body(name=solid["id"])
            place(body, np.array(solid["T"]))
            if solid["id"] == task["object"]:
                body.add_freejoint()
            d = solid["size"]
            box = solid["type"] == "box"
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX if box else mujoco.mjtGeom.mjGEOM_CYLINDER,
                size=[d[0] / 2, d[1] / 2, d[2] / 2] if box else [d[1], d[0] / 2, 0.0],
            )
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        with tempfile.NamedTemporaryFile("w", suffix=".xml", dir=case["folder"]) as file:
            file.write(_bare(case))
            file.flush()
            self.arm = Arm(self.model, self.joints, "tool", mjcf=file.name)
        index = [self.model.joint(name).qposadr[0] for name in self.joints]
        self.data.qpos[index] = task["start"]
        mujoco.mj_forward(self.model, self.data)

    def solve(self, seed: int) -> str | None:
        """Plan both motions; the name of the one that fails, None where both succeed."""
        task, config = self.task, CBiRRTConfig(timeout=TIMEOUT)
        T_object = np.array(next(s["T"] for s in task["solids"] if s["id"] == task["object"]))
        grips = np.array(task["grips"])
        tools = T_object @ grips
        before = tools.copy()
        before[:, :3, 3] -= BEFORE * tools[:, :3, 2]
        picked = self._plan(seed, config, [exactly(T) for T in before])
        if picked is None:
            return "pick"
        grip = grips[picked.goal_index]
        raised = [np.array(T) for T in task["places"]]
        lifted = T_object.copy()
        for T in (*raised, lifted):
            T[2, 3] += ABOVE
        holding = {task["object"]: (self.task["mount"], np.linalg.inv(grip))}
        carried = self._plan(
            seed, config, [exactly(T @ grip) for T in raised], start=exactly(lifted @ grip),
            holding=holding,
        )  # fmt: skip
        return "carry" if carried is None else None

    def _plan(self, seed: int, config, goal, **options):
        try:
            result = plan(
                self.model, self.data, self.arm, goal=goal, seed=seed, config=config, **options
            )
        except Exception as error:  # noqa: BLE001 (it raises where no goal has a configuration)
            print(f"  {type(error).__name__}: {str(error)[:120]}")
            return None
        return result if result.success else None


def exactly(T: np.ndarray) -> TSR:
    """The region that is one pose."""
    return TSR(T0_w=T, Bw=np.zeros((6, 2)))


def place(body, T: np.ndarray) -> None:
    """Put a body at a pose."""
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(T[:3, :3]).ravel())
    body.pos, body.quat = T[:3, 3], quaternion


def _urdf(case: dict) -> str:
    """The robot's URDF with the paths of its meshes as files, links that are fixed kept."""
    text = Path(case["urdf"]).read_text()
    text = re.sub(r"package://", case["packages"] + "/", text)
    text = re.sub(r"<visual>.*?</visual>", "", text, flags=re.DOTALL)
    options = '<mujoco><compiler strippath="false" fusestatic="false"/></mujoco>'
    return re.sub(r"(<robot[^>]*>)", r"\1" + options, text, count=1)


def _bare(case: dict) -> str:
    """The arm alone as MJCF."""
    spec = mujoco.MjSpec.from_string(_urdf(case))
    spec.body(case["mount"]).add_site(name="tool")
    spec.compile()
    return spec.to_xml()


if __name__ == "__main__":
    main()
