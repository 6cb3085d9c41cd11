"""Pick-and-place tasks in MotionBenchMaker's scenes, each with a combination known to be solvable.

The arm of a scene's problem is to go near an object. Here it grasps the object, and puts it down
elsewhere on what it stands on. One grasp and one place are looked for beforehand until somebody
else shows motions between them, a witness; they are hidden among seventeen other grasps and eleven
other places at random, of which nothing is known. Grasps and places that no configuration reaches
free of collision are not shown to the witness: in a cage they are most.

The scenes were made for the Panda. The UR5 does not get into the cages from where the Panda
stands, so it stands there where `place_base` finds the most room for the grasp.
"""

from collections.abc import Callable, Iterator, MutableMapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice, zip_longest
from pathlib import Path
from typing import NamedTuple, TypeAlias

import fcl
import numpy as np
import yaml

from benchmarks.example_arms import ARMS
from benchmarks.mbm_problems import Case, cases, panda, scene_at_root
from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.pose import (
    from_axis_angle,
    from_quaternion,
    inverse,
    rotation_z,
    to_quaternion,
    transform,
)
from obstacles.allowed_pairs import sorted_pair
from obstacles.checker import Checker
from obstacles.mesh import load_mesh
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Obstacle, Scene
from obstacles.shapes import Box, Cylinder, Mesh
from planning.options import Options
from planning.reach.base_placement import moved, place_base
from planning.reach.evaluation import ReachOptions, reach
from planning.reach.tolerance import Tolerance
from planning.sequence.region import grasp_region
from planning.sequence.stage import (
    Attach,
    Detach,
    Grasp,
    Gripper,
    Move,
    Pair,
    Place,
    Stage,
    StageSettings,
    Straight,
)
from planning.sequence.task import Task
from planning.sequence.world import World

GRASPS, PLACES = 18, 12
#: Scenes that have something to be picked, and somewhere to put it: shelves, cages, tables.
SORTS = (
    ("bookshelf_small", "bookshelf_tall", "bookshelf_thin"),
    ("cage",),
    ("table_pick", "table_under_pick"),
)
KINDS = tuple(chain.from_iterable(SORTS))
#: From the flange to between the finger tips [m].
_REACH_OF_HAND = 0.1034
#: Objects farther than this from between the finger tips are none that the problem is about [m].
_FAR = 0.1
#: What is nearer than this to an object holds it up [m].
_SUPPORTS = 2e-3
#: The place is at most so far from where the object stands, along x and y [m]; in a cage, whose
#: walls are near, no farther than the second.
_SHIFT, _SHIFT_IN_CAGE = 0.3, 0.15
#: Random grasps and places drawn for one task, and shown to the witness at most.
_ATTEMPTS, _SHOWN = 400, 6
#: Ways up and back at which the tool must get there too [m], as far as the stages ask at least.
_LIFT, _APPROACH = 0.01, 0.02
#: Acceleration limits of the UR5, whose URDF has none [rad/s^2].
_UR5_ACCELERATION = 10.0
_UR5_START = np.array([0.0, -1.9, 1.9, -1.57, -1.57, 0.0])
#: Where the UR5 may stand before a cage: how high, and how far towards it [m].
_HEIGHTS, _FORWARD = (0.0, 0.15, 0.3), (-0.1, 0.0, 0.1, 0.2)
#: Turns of the grasp about the tool's axis that are tried from there.
_TURNS = 24
#: The Panda's hand on its flange.
_HAND_TURN = -np.pi / 4.0


#: Whether motions of a task (with the text of its scene) were found that an independent check
#: finds clean.
Witness: TypeAlias = "Callable[[Task, str], bool]"
#: By scene the number of the first random place that has a witness; None where none has.
Known: TypeAlias = "MutableMapping[str, int | None]"


class Arm(NamedTuple):
    """An arm with a hand.

    Args:
        name: "panda" or "ur5".
        robot: Its geometry.
        touches: Links that may touch the object.
        start: Where it begins; None for the problem's own start.
    """

    name: str
    robot: RobotGeometry
    touches: tuple[str, ...]
    start: Array | None


@dataclass(frozen=True)
class TaskProblem:
    """One task.

    Args:
        name: Kind of scene and number.
        text: Of the scene.
        task: The stages with all grasps and places.
        object: Name of the object.
    """

    name: str
    text: str
    task: Task
    object: str


def arm(name: str, folder: Path) -> Arm:
    """The Panda with its hand, or a UR5 with the same hand.

    Args:
        name: "panda" or "ur5".
        folder: Of the Panda's files.
    """
    if name == "panda":
        fingers = ("panda_hand", "panda_leftfinger", "panda_rightfinger")
        return Arm(name, panda(folder), fingers, None)
    robot = ARMS["ur5"].geometry({"acceleration": _UR5_ACCELERATION})
    vertices, faces = load_mesh(hand_mesh(folder).read_bytes(), "obj")
    hand = Obstacle("hand", Mesh(vertices, faces), transform(rotation_z(_HAND_TURN)))
    return Arm(name, robot.attach(hand, "tool0"), ("wrist_3_link",), _UR5_START)


def hand_mesh(folder: Path) -> Path:
    """The file of the Panda's hand."""
    return next(path for path in sorted((folder / "meshes").rglob("hand.obj")))


def problems(
    chosen: Arm,
    folders: tuple[Path, Path],
    count: int,
    kinds: Sequence[str],
    witness: Witness,
    known: Known,
) -> Iterator[TaskProblem]:
    """Tasks for an arm, as many in shelves as in cages and on tables where there are.

    Args:
        chosen: The arm.
        folders: MotionBenchMaker's problems for the Panda, and the Panda's files.
        count: How many.
        kinds: Of scenes.
        witness: Finds motions of one grasp and one place.
        known: What it found before; what it finds is added.
    """
    problems_folder, folder = folders
    reference = panda(folder)
    found = list(cases(problems_folder, reference.chain.joint_names, 1))

    def tasks_of(sort: Sequence[str]) -> Iterator[TaskProblem]:
        lists = [[case for case in found if case.kind == f"{kind}_panda"] for kind in sort]
        for row, some in enumerate(zip_longest(*lists)):
            for case in filter(None, some):
                problem = _Maker(chosen, case, reference, row).problem(witness, known)
                if problem is not None:
                    yield problem

    turns = zip_longest(*(tasks_of([kind for kind in sort if kind in kinds]) for sort in SORTS))
    return islice(filter(None, chain.from_iterable(turns)), count)


class _Maker:
    """Makes the task of one scene."""

    def __init__(self, chosen: Arm, case: Case, reference: RobotGeometry, seed: int) -> None:
        self._chosen, self._case = chosen, case
        self._random = np.random.default_rng([seed, *case.name.encode()])
        self._T_tool = forward(reference.chain, case.goal)

    def problem(self, witness: Witness, known: Known) -> TaskProblem | None:
        """The task of the scene; None where no place has a witness."""
        case, chosen, random = self._case, self._chosen, self._random
        if case.name in known and known[case.name] is None:
            return None
        found = _object(scene_at_root(case.text), self._T_tool)
        if found is None:
            return None
        if case.kind.startswith("cage") and chosen.name != "panda":
            T_base_world = inverse(_base(chosen, scene_at_root(case.text), *found))
            case = replace(case, text=_moved_text(case.text, T_base_world))
        scene, (name, grip) = scene_at_root(case.text), found
        about = scene.obstacle(name)
        start = case.start if chosen.start is None else chosen.start
        held, world = _supports(scene, about), World(chosen.robot, scene)
        shift = _SHIFT_IN_CAGE if case.kind.startswith("cage") else _SHIFT
        shown = 0
        for attempt in range(_ATTEMPTS):
            place = _shifted(about.T_world_obstacle, random, shift)
            angle = 0.0 if attempt == 0 else random.uniform(-np.pi, np.pi)
            turned = grasp_region(grip, (0.0, 0.0, 1.0), (angle, angle), (0.0, 0.0), (1, 1))[0]
            if not _within_reach(chosen, scene, about, turned, place):
                continue
            stages = _stages(chosen, about.id, turned[None], place[None], held)
            if case.name not in known and witness(Task(world, start, stages), case.text):
                known[case.name] = attempt
            if known.get(case.name) == attempt:
                grips, places = _hidden(turned, place, about.T_world_obstacle, shift, random)
                stages = _stages(chosen, about.id, grips, places, held)
                return TaskProblem(case.name, case.text, Task(world, start, stages), about.id)
            shown += 1
            if shown == _SHOWN and case.name not in known:
                break
        known[case.name] = None
        return None


def _object(scene: Scene, T_tool: Array) -> tuple[str, Array] | None:
    """What a problem's goal is about, and the tool's grasp of it; None where nothing is near."""
    tip = T_tool[:3, 3] + _REACH_OF_HAND * T_tool[:3, 2]
    about = min(
        scene.obstacles, key=lambda o: float(np.linalg.norm(o.T_world_obstacle[:3, 3] - tip))
    )
    if np.linalg.norm(about.T_world_obstacle[:3, 3] - tip) > _FAR:
        return None
    ahead = float((about.T_world_obstacle[:3, 3] - tip) @ T_tool[:3, 2])
    T_grasp = transform(T_tool[:3, :3], T_tool[:3, 3] + ahead * T_tool[:3, 2])
    return about.id, inverse(about.T_world_obstacle) @ T_grasp


def _base(chosen: Arm, scene: Scene, name: str, grip: Array) -> Array:
    """Where the base has most room for a grasp and none of the arm is in the way at the start.

    Returns:
        T_world_base.
    """
    about = scene.obstacle(name)
    others = Scene([one for one in scene.obstacles if one.id != name])
    x, y, _ = about.T_world_obstacle[:3, 3]
    ahead = np.array([x, y, 0.0]) / np.hypot(x, y)
    up = np.array([0.0, 0.0, 1.0])
    bases = [transform(np.eye(3), far * ahead + high * up) for high in _HEIGHTS for far in _FORWARD]
    assert chosen.start is not None
    bases = [
        T for T in bases
        if Checker.of(chosen.robot, moved(scene, inverse(T))).valid(chosen.start)
    ]  # fmt: skip
    options = ReachOptions(Tolerance.free("rz", samples=_TURNS), choice="clearance", threads=1)
    grasp = about.T_world_obstacle @ grip
    return place_base(chosen.robot, others, grasp[None], bases, options)[0].T_world_base


def _moved_text(text: str, T: Array) -> str:
    """The text of a scene with every object moved by T."""
    read = yaml.safe_load(text)
    for entry in read["world"]["collision_objects"]:
        for pose in entry["primitive_poses"]:
            R = from_quaternion(pose["orientation"])
            there = T @ transform(R, pose["position"])
            pose["position"] = there[:3, 3].tolist()
            pose["orientation"] = to_quaternion(there[:3, :3]).tolist()
    return str(yaml.safe_dump(read))


def _within_reach(chosen: Arm, scene: Scene, about: Obstacle, grip: Array, place: Array) -> bool:
    """Whether the tool gets to a grasp and to that at a place free of collision, and above both.

    The object itself is looked at in the grasp only, where nothing but the fingers may touch it.
    """
    others = Scene([one for one in scene.obstacles if one.id != about.id])
    fingers = Scene(scene.obstacles, {sorted_pair(link, about.id) for link in chosen.touches})
    at = np.array([about.T_world_obstacle @ grip, place @ grip])
    above, before = at.copy(), at.copy()
    above[:, 2, 3] += _LIFT
    before[:, :3, 3] -= _APPROACH * at[:, :3, 2]
    options = ReachOptions(choice="first", clearance=False, threads=1)
    found = reach(chosen.robot, others, np.concatenate([at, above, before]), options)
    if not found.is_reached.all():
        return False
    return bool(reach(chosen.robot, fingers, at[:1], options).is_reached.all())


def _shifted(T: Array, random: np.random.Generator, most: float) -> Array:
    """A pose on the same level, at most so far away along x and y, turned about the vertical."""
    shift = [*random.uniform(-most, most, 2), 0.0]
    turn = from_axis_angle(np.array([0.0, 0.0, 1.0]), random.uniform(-np.pi, np.pi))
    return np.asarray(transform(turn @ T[:3, :3], T[:3, 3] + shift))


def _hidden(
    grip: Array, place: Array, T_object: Array, shift: float, random: np.random.Generator
) -> tuple[Array, Array]:
    """All grasps and places, the known ones among them."""
    others = [
        grasp_region(grip, (0.0, 0.0, 1.0), (angle, angle), (offset, offset), (1, 1))[0]
        for angle, offset in zip(
            random.uniform(-np.pi, np.pi, GRASPS - 1),
            random.uniform(-0.02, 0.02, GRASPS - 1),
            strict=True,
        )
    ]
    more = [_shifted(T_object, random, shift) for _ in range(PLACES - 1)]
    grips, places = np.array([grip, *others]), np.array([place, *more])
    return grips[random.permutation(GRASPS)], places[random.permutation(PLACES)]


def _supports(scene: Scene, about: Obstacle) -> tuple[Pair, ...]:
    """Pairs of the object and what it stands on."""

    def solid(obstacle: Obstacle) -> "fcl.CollisionObject":
        shape, T = obstacle.shape, obstacle.T_world_obstacle
        if isinstance(shape, Box):
            made = fcl.Box(*shape.size)
        else:
            assert isinstance(shape, Cylinder)
            made = fcl.Cylinder(shape.radius, shape.height)
        return fcl.CollisionObject(made, fcl.Transform(T[:3, :3], T[:3, 3]))

    one = solid(about)
    return tuple(
        (about.id, other.id)
        for other in scene.obstacles
        if other.id != about.id and fcl.distance(one, solid(other)) < _SUPPORTS
    )


def _stages(
    chosen: Arm, name: str, grips: Array, places: Array, supports: tuple[Pair, ...]
) -> tuple[Stage, ...]:
    """Pick and place with these grasps and places."""
    near = StageSettings(allowed=supports, options=Options(timeout=30.0))
    free = StageSettings(options=Options(timeout=30.0))
    return (
        Move(settings=free),
        Straight("approach", [0, 0, 1], "tool", 0.02, 0.08, free),
        Grasp(name, grips, chosen.touches, settings=free),
        Gripper("close", settings=free),
        Attach(name, settings=near),
        Straight("lift", [0, 0, 1], "root", 0.01, 0.05, near),
        Move(settings=free),
        Straight("approach", [0, 0, -1], "root", 0.01, 0.05, near),
        Place(None, places, settings=near),
        Gripper("open", settings=near),
        Detach(settings=free),
        Straight("retreat", [0, 0, -1], "tool", 0.02, 0.08, free),
    )
