"""Planning problems: a robot in a scene, from a configuration to a goal."""

import hashlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidGoal, InvalidRobotState
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.placement import place
from obstacles.scenes.scene import Scene
from planning.constraints.constraint_set import ConstraintSet


@dataclass(frozen=True, slots=True, eq=False)
class JointGoal:
    """Be at this configuration.

    Args:
        joints: Shape (n,) [rad or m].
        velocity: There, shape (n,); at rest where none is given.
        acceleration: There, shape (n,); None where any will do.
    """

    joints: Array
    velocity: Array | None = None
    acceleration: Array | None = None

    if TYPE_CHECKING:  # the constructor takes whatever makes an array

        def __init__(
            self,
            joints: ArrayLike,
            velocity: ArrayLike | None = None,
            acceleration: ArrayLike | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", frozen(self.joints))
        for name in ("velocity", "acceleration"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen(getattr(self, name)))


@dataclass(frozen=True, slots=True, eq=False)
class PoseGoal:
    """Bring the tip to this pose, in any configuration that does.

    Args:
        T_base_tip: Shape (4, 4).
        position_tolerance: How far off the tip may end [m].
        orientation_tolerance: How far turned it may end [rad].
    """

    T_base_tip: Array
    position_tolerance: float = 1e-4
    orientation_tolerance: float = 1e-3

    if TYPE_CHECKING:  # the constructor takes whatever makes an array

        def __init__(
            self,
            T_base_tip: ArrayLike,
            position_tolerance: float = 1e-4,
            orientation_tolerance: float = 1e-3,
        ) -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_base_tip", frozen(self.T_base_tip))
        if self.T_base_tip.shape != (4, 4) or not np.isfinite(self.T_base_tip).all():
            raise InvalidGoal("a goal's pose must be a finite 4x4 transform")
        tolerances = self.position_tolerance, self.orientation_tolerance
        if not all(0.0 < one < np.inf for one in tolerances):
            raise InvalidGoal("a goal's tolerances must be positive and finite")


Goal = JointGoal | PoseGoal


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """A motion to be found.

    Args:
        robot: The arm with its geometry.
        scene: The obstacles; the frame "tool" is where the tool is at the start.
        start: Where it stands, shape (n,) [rad or m].
        goals: Any one of these is to be reached.
        margin: Distance to keep from obstacles beyond their own margins [m].
        start_state_tolerance: A start or goal this little outside a limit is snapped onto it
            [rad or m]; None for what a measured start may miss, and a goal by rounding.
        constraints: What the whole motion has to hold; its clearance raises the margin.
        start_velocity: At the start, shape (n,); at rest where none is given.
        start_acceleration: At the start, shape (n,); None where any will do.
        field_cell: Robot and scene of a potential field where collisions of bodies are left out:
            obstacles push control points, solids or none.

    Raises:
        InvalidGoal: There is no goal, or the margin is negative.
        InvalidRobotState: A joint vector has the wrong length or is not finite.
    """

    robot: RobotGeometry
    scene: Scene
    start: Array
    goals: tuple[Goal, ...]
    margin: float = 0.0
    start_state_tolerance: float | None = None
    constraints: ConstraintSet | None = None
    start_velocity: Array | None = None
    start_acceleration: Array | None = None
    field_cell: tuple[RobotGeometry, Scene] | None = None
    #: Whether the motion is to begin or end with a velocity or acceleration.
    moving: bool = field(init=False)

    def __post_init__(self) -> None:
        if not isinstance(self.robot, RobotGeometry):
            raise InvalidGoal(f"a problem's robot is {self.robot!r:.60}, not what load_robot makes")
        chain = self.robot.chain
        start = chain.state(self.start, "start.joints")
        start.setflags(write=False)
        object.__setattr__(self, "start", start)
        if not isinstance(self.scene, Scene) or self.scene.frames or self.scene.free:
            object.__setattr__(self, "scene", place(self.scene, chain, self.start))
        if self.field_cell is not None:
            body, scene = self.field_cell
            object.__setattr__(self, "field_cell", (body, place(scene, chain, self.start)))
        for name in ("start_velocity", "start_acceleration"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen(getattr(self, name)))
        if not self.goals:
            raise InvalidGoal("no goal is given")
        for goal in self.goals:
            if not isinstance(goal, Goal):
                raise InvalidGoal(f"a goal is {goal!r:.60}, neither a JointGoal nor a PoseGoal")
            if isinstance(goal, JointGoal):
                chain.state(goal.joints, "goal.joints")
        moving = False
        for name, rates in self._rates():
            moving = moving or bool(rates.any())
            if rates.shape != (chain.n,) or not np.isfinite(rates).all():
                raise InvalidRobotState(
                    f"{name} must be {chain.n} finite numbers, one for each joint",
                    hint=f"The order is: {', '.join(chain.joint_names)}.",
                )
        object.__setattr__(self, "moving", moving)
        if not (np.isfinite(self.margin) and self.margin >= 0.0):
            raise InvalidGoal(f"margin is {self.margin}; it must be 0 or more")
        if self.constraints is not None:
            object.__setattr__(self, "margin", max(self.margin, self.constraints.margin))

    def _rates(self) -> list[tuple[str, Array]]:
        """Velocities and accelerations that are given, with their names on the wire."""
        given = [
            ("start.velocities", self.start_velocity),
            ("start.accelerations", self.start_acceleration),
        ]
        for goal in self.goals:
            if isinstance(goal, JointGoal):
                given += [
                    ("goal.velocities", goal.velocity),
                    ("goal.accelerations", goal.acceleration),
                ]
        return [(name, rates) for name, rates in given if rates is not None]

    @property
    def content_hash(self) -> str:
        """Digest of all that is asked; worked out anew each time, few problems are asked."""
        digest = hashlib.sha256()
        digest.update(self.robot.content_hash.encode() + self.scene.content_hash.encode())
        digest.update(self.start.tobytes())
        for goal in self.goals:
            if isinstance(goal, JointGoal):
                digest.update(b"j" + goal.joints.tobytes())
            else:
                digest.update(b"p" + goal.T_base_tip.tobytes())
                numbers = [goal.position_tolerance, goal.orientation_tolerance]
                digest.update(np.array(numbers).tobytes())
        tolerance = -1.0 if self.start_state_tolerance is None else self.start_state_tolerance
        digest.update(np.array([self.margin, tolerance]).tobytes())
        if self.constraints is not None:
            digest.update(self.constraints.content_hash.encode())
        for name, rates in self._rates():
            digest.update(name.encode() + rates.tobytes())
        return digest.hexdigest()
