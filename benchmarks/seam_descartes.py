"""Seams by tesseract's Descartes, in an interpreter of its own: a ladder graph with its checks.

    PYTHON benchmarks/seam_descartes.py SEAMS.json WAYS.json

``benchmarks.seams --descartes PYTHON`` writes the first file and reads the second. It needs
``pip install tesseract-robotics-nanobind``, and nothing of this project. Tesseract is given the
same description, allowed collisions and post; the closed form of its own (OPW, UR); the spin of the
tool sampled every 15 degrees; and a check of every configuration, on one thread. Of what it finds
the joints are written down, to be judged by who asked.
"""

import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from tesseract_robotics import tesseract_command_language as language
from tesseract_robotics import tesseract_common as common
from tesseract_robotics import tesseract_motion_planners_descartes as descartes
from tesseract_robotics.tesseract_environment import Environment
from tesseract_robotics.tesseract_motion_planners import PlannerRequest

_NAMESPACE = "DescartesMotionPlannerTask"
_SPIN = np.radians(15.0)
_PLUGINS = """kinematic_plugins:
  search_libraries: [tesseract_kinematics_opw_factories, tesseract_kinematics_ur_factories]
  fwd_kin_plugins:
    manipulator:
      default: KDLFwdKinChain
      plugins:
        KDLFwdKinChain:
          class: KDLFwdKinChainFactory
          config: {{base_link: {base}, tip_link: {tip}}}
  inv_kin_plugins:
    manipulator:
      default: {solver}
      plugins:
        {solver}:
          class: {solver}Factory
          config: {config}
"""
_CONTACTS = """contact_manager_plugins:
  search_libraries: [tesseract_collision_bullet_factories]
  discrete_plugins:
    default: BulletDiscreteBVHManager
    plugins: {BulletDiscreteBVHManager: {class: BulletDiscreteBVHManagerFactory}}
  continuous_plugins:
    default: BulletCastBVHManager
    plugins: {BulletCastBVHManager: {class: BulletCastBVHManagerFactory}}
"""


def environment(arm: dict[str, Any], folder: Path) -> Any:
    """Tesseract's model of an arm and what stands around it."""
    kinematics, contacts = folder / "kinematics.yaml", folder / "contacts.yaml"
    kinematics.write_text(_PLUGINS.format(**arm))
    contacts.write_text(_CONTACTS)
    disabled = "".join(
        f'<disable_collisions link1="{a}" link2="{b}" reason="Never"/>' for a, b in arm["allowed"]
    )
    srdf = (
        f'<robot name="{arm["name"]}"><group name="manipulator">'
        f'<chain base_link="{arm["base"]}" tip_link="{arm["tip"]}"/></group>'
        f'<kinematics_plugin_config filename="file://{kinematics}"/>'
        f'<contact_managers_plugin_config filename="file://{contacts}"/>{disabled}</robot>'
    )
    note = '<robot xmlns:tesseract="http://ros.org/wiki/tesseract" tesseract:make_convex="false" '
    (folder / "arm.urdf").write_text(arm["urdf"].replace("<robot ", note))
    (folder / "arm.srdf").write_text(srdf)
    files = [common.FilesystemPath(str(folder / f"arm.{kind}")) for kind in ("urdf", "srdf")]
    env = Environment()
    if not env.init(*files, common.GeneralResourceLocator()):
        raise SystemExit("tesseract does not take the robot")
    return env


def follow(env: Any, arm: dict[str, Any], poses: np.ndarray) -> tuple[list[list[float]], float]:
    """A way through poses (k, 4, 4), none where there is none, and the time taken [s]."""
    info = common.ManipulatorInfo()
    info.tcp_frame, info.working_frame = arm["tip"], arm["base"]
    info.manipulator, info.manipulator_ik_solver = "manipulator", arm["solver"]
    program = language.CompositeInstruction(language.DEFAULT_PROFILE_KEY, info)
    for pose in poses:
        point = language.CartesianWaypointPoly_wrap_CartesianWaypoint(
            language.CartesianWaypoint(common.Isometry3d(pose))
        )
        move = language.MoveInstruction(
            point, language.MoveInstructionType_LINEAR, language.DEFAULT_PROFILE_KEY
        )
        program.appendMoveInstruction(language.MoveInstructionPoly_wrap_MoveInstruction(move))
    profile = descartes.DescartesDefaultMoveProfileD()
    profile.target_pose_fixed = False
    profile.target_pose_sample_axis = np.array([0.0, 0.0, 1.0])
    profile.target_pose_sample_resolution = _SPIN
    profile.enable_collision, profile.enable_edge_collision = True, False
    profiles = language.ProfileDictionary()
    profiles.addProfile(
        _NAMESPACE, language.DEFAULT_PROFILE_KEY, descartes.cast_DescartesMoveProfileD(profile)
    )
    request = PlannerRequest()
    request.instructions, request.env, request.profiles = program, env, profiles
    planner = descartes.DescartesMotionPlannerD(_NAMESPACE)
    began = time.process_time()
    response = planner.solve(request)
    seconds = time.process_time() - began
    if not response.successful:
        return [], seconds
    moves = (language.InstructionPoly_as_MoveInstructionPoly(one) for one in response.results)
    states = (language.WaypointPoly_as_StateWaypointPoly(move.getWaypoint()) for move in moves)
    return [np.ravel(state.getPosition()).tolist() for state in states], seconds


def main() -> None:
    """Answer all seams of a file."""
    asked = json.loads(Path(sys.argv[1]).read_text())
    with tempfile.TemporaryDirectory() as folder:
        env = environment(asked["arm"], Path(folder))
        ways = [follow(env, asked["arm"], np.array(poses)) for poses in asked["seams"]]
    Path(sys.argv[2]).write_text(json.dumps(ways))


if __name__ == "__main__":
    main()
