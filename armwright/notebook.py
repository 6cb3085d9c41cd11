"""Pages of motions, shown inside of notebooks or kept as files."""

import html
from dataclasses import dataclass, field
from pathlib import Path

from kinematics.arrays import typed
from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.proof.certificate import certify
from planning.result import Plan
from planning.sequence.result import SequencePlan
from planning.tours.result import Tour

#: Height of a page inside of a notebook [pixels].
_HEIGHT = 640


@dataclass(frozen=True, slots=True)
class Page:
    """One HTML page that needs nothing else; the last value of a notebook's cell is shown.

    Args:
        robot: Name of the robot.
        html: The page.
    """

    robot: str
    html: str = field(repr=False)

    def save(self, path: str | Path) -> Path:
        """Write the page to a file that any browser opens; gives its path."""
        file = Path(path)
        file.write_text(self.html, "utf-8")
        return file

    def _repr_html_(self) -> str:
        """The page in a frame of its own: its scripts see nothing of the notebook."""
        source = html.escape(self.html, quote=True)
        style = f"width: 100%; height: {_HEIGHT}px; border: 0"
        return f'<iframe srcdoc="{source}" sandbox="allow-scripts" style="{style}"></iframe>'


@typed
def view(
    plan: Plan | Trajectory | Tour | SequencePlan,
    robot: RobotGeometry | None = None,
    scene: Scene | None = None,
) -> Page:
    """The page of a motion: the robot among its obstacles, curves, and the proof in words.

    Args:
        plan: A plan, also of a seam; a task, which has its own robot, scenes and proofs; or a
            trajectory or tour that is proved for the page.
        robot: The robot with what it holds; that of the plan if left out.
        scene: The obstacles; those of the plan if left out, or none.

    Raises:
        InvalidOption: A trajectory or tour is given without its robot, or a task with another.
    """
    from service.viewer import library  # noqa: PLC0415  seldom needed, and long

    if isinstance(plan, SequencePlan):
        if robot is not None or scene is not None:
            raise InvalidOption(
                "view: each stage of a task has its own robot and scene, with what is held in it",
                hint="Leave robot and scene out: aw.view(task).",
            )
        name = plan.stages[0].after.robot.chain.name
        return Page(name, library.task_page(plan).decode())
    around = plan.surroundings if isinstance(plan, Plan) else None
    if around is not None and robot is None and scene is None:
        assert isinstance(plan, Plan)
        motion: Trajectory | Tour = plan.trajectory
        robot, scene, certificate = around.robot, around.scene, plan.certificate
    else:
        robot = around.robot if robot is None and around is not None else robot
        if robot is None:
            raise InvalidOption(
                "view: a trajectory or tour does not tell its robot",
                hint="Give it: aw.view(motion, robot, scene).",
            )
        default = Scene() if around is None else around.scene
        scene = default if scene is None else scene
        motion = plan.trajectory if isinstance(plan, Plan) else plan
        whole = motion.trajectory if isinstance(motion, Tour) else motion
        certificate = certify(whole, robot, scene)
    made = library.motion_page(motion, certificate, robot, scene)
    return Page(robot.chain.name, made.decode())
