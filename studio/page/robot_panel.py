"""Panels of robot and goal: choice, upload, lint, sliders, and the frame that is dragged.

Fields for numbers as people write them: texts, so that no sign and no digit is lost.

Fields for numbers of the browser turn a half-typed "-0" into 0 and cut digits to those of a step.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Literal

import numpy as np
import viser

from armwright_client import Pose, Robot
from studio.page.panel import Page, Text, on_user_update, put_value
from studio.pose import pose_of, roll_pitch_yaw, wxyz
from studio.state import Branch

Quantity = Literal["length", "angle", "either"]
#: Units of each choice, with how many of them a metre or a radian has.
UNITS: dict[str, dict[Quantity, tuple[str, float]]] = {
    "m, rad": {"length": ("m", 1.0), "angle": ("rad", 1.0), "either": ("rad or m", 1.0)},
    "mm, degrees": {
        "length": ("mm", 1e3),
        "angle": ("°", 180.0 / math.pi),
        "either": ("rad or m", 1.0),
    },
}
#: Shown digits: more than a drag or a person means, fewer than rounding shows.
_DIGITS = 10
_SAME = 1e-12


class Units:
    """The units of all fields of the page.

    Args:
        gui: Interface of viser.
    """

    def __init__(self, gui: viser.GuiApi) -> None:
        self._fields: list[NumbersField] = []
        self._choice = gui.add_dropdown("Units", [*UNITS])
        on_user_update(self._choice, self._show)

    def of(self, quantity: Quantity) -> tuple[str, float]:
        """The unit's sign, and how many of it a metre or a radian has."""
        return UNITS[self._choice.value][quantity]

    def _show(self, _: str) -> None:
        for field in self._fields:
            field.show_units()

    def add(self, field: "NumbersField") -> None:
        """Have a field follow the choice."""
        self._fields.append(field)

    def remove(self, field: "NumbersField") -> None:
        """Have a field follow no more."""
        self._fields.remove(field)


class NumbersField:
    """One or several numbers in one field.

    Args:
        gui: Interface of viser.
        label: Label without the unit.
        units: Units of the page.
        quantity: Quantity of the numbers.
        values: Values that are shown first [m or rad].
        act: Called with the values that a person typed [m or rad].
        least: Values below are not taken: half-typed sizes are 0.
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        label: str,
        units: Units,
        quantity: Quantity,
        values: Sequence[float],
        act: Callable[[list[float]], None],
        least: float = -math.inf,
    ) -> None:
        self._label, self._units, self._quantity = label, units, quantity
        self._values, self._act, self._least = tuple(values), act, least
        #: Values that were typed and have not come back from the state yet, oldest first.
        self._sent: list[tuple[float, ...]] = []
        self._widget = gui.add_text(label, "")
        units.add(self)
        self.show_units()
        on_user_update(self._widget, lambda _: self._take())

    def show(self, values: Sequence[float]) -> None:
        """Show values, unless they are those that are typed, or being typed.

        Args:
            values: Values of the state [m or rad].
        """
        for k, sent in enumerate(self._sent[:-1]):
            if _same(values, sent):  # the person has typed on meanwhile
                del self._sent[: k + 1]
                return
        self._sent.clear()
        typed, before = self._typed(), self._values
        self._values = tuple(values)
        if _same(self._values, typed if typed is not None else before):
            return
        self._write()

    def show_units(self) -> None:
        """Show the values in the units of the page."""
        self._widget.label = f"{self._label} [{self._units.of(self._quantity)[0]}]"
        self._write()

    def remove(self) -> None:
        """Take the field from the page."""
        self._units.remove(self)
        self._widget.remove()

    def _write(self) -> None:
        factor = self._units.of(self._quantity)[1]
        texts = [f"{round(value * factor, _DIGITS):.{_DIGITS}g}" for value in self._values]
        put_value(self._widget, ", ".join(texts))

    def _typed(self) -> tuple[float, ...] | None:
        """The values as they are typed [m or rad]; None while they are no such numbers."""
        words = self._widget.value.replace(",", " ").replace(";", " ").split()
        try:
            numbers = [float(word) for word in words]
        except ValueError:
            return None
        if len(numbers) != len(self._values) or not all(map(math.isfinite, numbers)):
            return None
        factor = self._units.of(self._quantity)[1]
        values = tuple(number / factor for number in numbers)
        return values if min(values) >= self._least else None

    def _take(self) -> None:
        typed = self._typed()
        if typed is not None and not _same(typed, self._values):
            self._values = typed
            self._sent.append(typed)
            self._act(list(typed))


class PoseFields:
    """Position and fixed-axis angles of a pose.

    Args:
        gui: Interface of viser.
        units: Units of the page.
        pose: Pose that is shown first.
        act: Called with the pose that a person typed.
    """

    def __init__(
        self, gui: viser.GuiApi, units: Units, pose: Pose, act: Callable[[Pose], None]
    ) -> None:
        self._act = act
        self._at, self._turn = list(pose.position), list(roll_pitch_yaw(pose))
        label = "Roll, pitch, yaw"
        self._position = NumbersField(gui, "Position", units, "length", self._at, self._move)
        self._angles = NumbersField(gui, label, units, "angle", self._turn, self._rotate)

    def show(self, pose: Pose) -> None:
        """Show a pose; angles that mean the same stay as they were typed."""
        self._at = list(pose.position)
        typed = Pose(position=self._at, rpy=self._turn)
        if not np.allclose(wxyz(typed), wxyz(pose)) and not np.allclose(wxyz(typed), -wxyz(pose)):
            self._turn = list(roll_pitch_yaw(pose))
        self._position.show(self._at)
        self._angles.show(self._turn)

    def remove(self) -> None:
        """Take the fields from the page."""
        self._position.remove()
        self._angles.remove()

    def _move(self, position: list[float]) -> None:
        self._at = position
        self._act(Pose(position=self._at, rpy=self._turn))

    def _rotate(self, angles: list[float]) -> None:
        self._turn = angles
        self._act(Pose(position=self._at, rpy=self._turn))


def _same(a: Sequence[float], b: Sequence[float]) -> bool:
    return all(math.isclose(x, y, rel_tol=_SAME, abs_tol=_SAME) for x, y in zip(a, b, strict=True))


#: Length of the handles of the goal's frame [m].
_HANDLE = 0.25


class GoalPanel:
    """The goal's frame in the scene and the list of branches beside it.

    Args:
        page: Page of the studio.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        gui = page.server.gui
        with gui.add_folder("Goal pose"):
            self._pose = PoseFields(gui, page.units, Pose.at(0.0, 0.0, 0.0), self._move)
            self._text = Text(gui, "Drag the frame at the tip, or type a pose.")
            self._choice = gui.add_dropdown("Take branch", ["–"])
        on_user_update(self._choice, self._take_branch)
        self._handle = page.server.scene.add_transform_controls(
            "/goal", scale=_HANDLE, depth_test=False
        )

        @self._handle.on_update
        def _(event: viser.TransformControlsEvent) -> None:
            position = np.asarray(event.target.position, dtype=float)
            pose = pose_of(position, np.asarray(event.target.wxyz, dtype=float))
            self._move(pose, ended=event.phase == "end")

    def refresh(self, tip: Pose, branches: tuple[Branch, ...]) -> None:
        """Show the goal's pose and the branches.

        Args:
            tip: Pose of the tip at the goal.
            branches: Configurations that reach it.
        """
        self._handle.position = np.array(tip.position)
        self._handle.wxyz = wxyz(tip)
        self.refresh_branches(tip, branches)
        put_value(self._choice, "–")

    def refresh_branches(self, tip: Pose, branches: tuple[Branch, ...]) -> None:
        """Show the branches, and leave the frame where it is being dragged."""
        self._pose.show(tip)
        self._text.show(describe(branches))
        labels = ("–", *(branch.label for branch in branches))
        if labels != tuple(self._choice.options):
            self._choice.options = labels

    def _take_branch(self, label: str) -> None:
        number = label.partition(" ")[0]
        if not number.isdigit():
            return

        self._page.run("branch", lambda: self._page.workbench.choose_branch(int(number)))

    def _move(self, pose: Pose, *, ended: bool = True) -> None:
        page = self._page

        def command() -> None:
            branches = page.workbench.move_goal(pose, "goal pose")
            page.show_goal()
            if ended:
                page.workbench.end_drag()
                page.refresh()
            else:
                self.refresh_branches(pose, branches)

        page.queue.put("goal pose", command)


def describe(branches: tuple[Branch, ...]) -> str:
    """The branches as a list in Markdown.

    Args:
        branches: Configurations that reach the goal.
    """
    if not branches:
        return "**No configuration reaches this pose.**"
    valid = sum(not branch.reason for branch in branches)
    lines = [f"**{valid} of {len(branches)} configurations are valid.**", ""]
    for branch in branches:
        detail = f": {branch.reason}" if branch.reason else ""
        name = f" ({branch.name})" if branch.name else ""
        lines.append(f"- {branch.label}{name}{detail}")
    return "\n".join(lines)


#: Range of a finger without limits [rad].
_UNBOUNDED = (-3.14, 3.14)
#: In the dropdown of tools: the robot's own tip.
NO_TOOL = "none"
#: Steps of a joint slider over its range.
_STEPS = 1000


class RobotPanel:
    """Choice and upload of a robot, and its lint.

    Args:
        page: Page of the studio.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        gui, workbench = page.server.gui, page.workbench
        self._choice = gui.add_dropdown(
            "Robot", workbench.robot_names(), initial_value=workbench.state.robot
        )
        on_user_update(
            self._choice, lambda name: page.queue.put("robot", lambda: _choose(page, name))
        )
        self._tool = gui.add_dropdown(
            "Tool", [NO_TOOL], hint="A stored tool: goals mean its tip, and its solids count."
        )
        on_user_update(self._tool, lambda name: page.queue.put("tool", lambda: self._mount(name)))
        self._tip = gui.add_text(
            "Tip link", "", hint="Of an upload with several arms: where the chain ends."
        )
        upload = gui.add_upload_button(
            "Upload a URDF or .zip",
            hint="Or a .xacro or MJCF. A .zip holds it with its meshes, perhaps an SRDF.",
        )

        @upload.on_upload
        def _(event: viser.GuiEvent[viser.GuiUploadButtonHandle]) -> None:
            file = event.target.value
            page.queue.put("robot", lambda: self._upload(file.name, file.content))

        self._looks = gui.add_checkbox(
            "Visual meshes", True, hint="Off: the collision geometry, which the proof is about."
        )
        on_user_update(self._looks, lambda on: page.queue.put("looks", lambda: page.show_looks(on)))
        self._facts = Text(gui)
        with gui.add_folder("Notes on the description", expand_by_default=False) as self._notes:
            self._lint = Text(gui)

    def offer_looks(self, known: bool) -> bool:
        """Whether the robot is to be drawn by its visual meshes.

        Args:
            known: Whether the robot has visual meshes; the switch is off limits where it has none.
        """
        self._looks.disabled = not known
        return known and self._looks.value

    def refresh(self) -> None:
        """Show the facts of the present robot."""
        workbench = self._page.workbench
        put_value(self._choice, workbench.state.robot)
        tools = [NO_TOOL, *workbench.tool_names()]
        if tools != [*self._tool.options]:
            self._tool.options = tools
        put_value(self._tool, workbench.state.tool or NO_TOOL)
        self._facts.show(facts(workbench.model))
        lint = notes(workbench.model)
        self._notes.visible = bool(lint)
        self._lint.show(lint)

    def _mount(self, name: str) -> None:
        self._page.workbench.mount(None if name == NO_TOOL else name)
        self._page.rebuild()

    def _upload(self, name: str, content: bytes) -> None:
        workbench = self._page.workbench
        workbench.upload_robot(name, content, self._tip.value.strip() or None)
        self._choice.options = workbench.robot_names()
        self._page.rebuild()


class Sliders:
    """Sliders of joints in a folder.

    Args:
        page: Page of the studio.
        title: Title of the folder.
        ranges: Range of each joint by its name [rad or m].
        read: Answers the present positions by joint [rad or m].
        move: Called with a joint that a person moved, and its new position.
        states: Named configurations.
        take: Called with all positions that were typed, or of a named configuration.
    """

    def __init__(
        self,
        page: Page,
        title: str,
        ranges: Mapping[str, tuple[float, float]],
        read: Callable[[], Mapping[str, float]],
        move: Callable[[str, float], None],
        states: Mapping[str, Sequence[float]] = MappingProxyType({}),
        take: Callable[[list[float]], None] | None = None,
    ) -> None:
        self._read = read
        gui = page.server.gui
        self._folder = gui.add_folder(title, visible=bool(ranges))
        self._sliders: dict[str, viser.GuiSliderHandle[float]] = {}
        self._all: NumbersField | None = None
        with self._folder:
            if take is not None and states:
                named = gui.add_dropdown("Named state", ["–", *states])
                on_user_update(named, lambda name: take([*states.get(name, read().values())]))
            if take is not None:
                # Sliders cut what is typed to their steps.
                types = set(page.workbench.model.joint_types)
                quantity: Quantity = "either" if "prismatic" in types else "angle"
                values = [*read().values()]
                self._all = NumbersField(gui, "All", page.units, quantity, values, take)
            for name, (low, high) in ranges.items():
                slider = gui.add_slider(name, low, high, (high - low) / _STEPS or 1.0, low)
                on_user_update(slider, partial(move, name))
                self._sliders[name] = slider
        self.refresh()

    def refresh(self) -> None:
        """Show the present positions."""
        values = self._read()
        if self._all is not None:
            self._all.show([*values.values()])
        for name, slider in self._sliders.items():
            put_value(slider, min(max(values[name], slider.min), slider.max))

    def remove(self) -> None:
        """Take the sliders from the page."""
        if self._all is not None:
            self._all.remove()
        self._folder.remove()


def joint_sliders(page: Page, which: str) -> Sliders:
    """Sliders of a configuration.

    Args:
        page: Page of the studio.
        which: "start" or "goal".
    """
    workbench, states = page.workbench, page.workbench.model.states
    names = workbench.model.joint_names

    def read() -> dict[str, float]:
        state = workbench.state
        joints = state.start if which == "start" else state.goal_joints
        return dict(zip(names, joints, strict=True))

    def set_joints(joints: list[float], key: str | None) -> None:
        def command() -> None:
            if which == "start":
                workbench.set_start(joints, key)
                page.show_start()
            else:
                workbench.set_goal_joints(joints, key)
                workbench.solve_goal()

        page.run(f"joints {which}", command)

    def move(name: str, value: float) -> None:
        set_joints([*(read() | {name: float(value)}).values()], f"{which} {name}")

    title = f"{which.capitalize()} joints [rad or m]"
    ranges = dict(zip(names, workbench.joint_ranges(), strict=True))
    return Sliders(page, title, ranges, read, move, states, lambda q: set_joints(q, None))


def finger_sliders(page: Page) -> Sliders:
    """Sliders of the gripper's joints, which stand still during a plan.

    Args:
        page: Page of the studio.
    """
    workbench, joints = page.workbench, page.workbench.model.fingers
    low, high = _UNBOUNDED
    ranges = {
        name: (low if joint.lower is None else joint.lower,
               high if joint.upper is None else joint.upper)
        for name, joint in joints.items()
    }  # fmt: skip

    def read() -> dict[str, float]:
        return {name: joint.position for name, joint in joints.items()} | dict(
            workbench.state.fingers
        )

    def move(name: str, value: float) -> None:
        def command() -> None:
            workbench.set_finger(name, float(value))
            page.show_start()

        page.run(f"finger {name}", command)

    return Sliders(page, "Gripper [rad or m]", ranges, read, move)


def facts(model: Robot) -> str:
    """Joints and missing limits of a robot, in Markdown.

    Args:
        model: Model of the robot.
    """
    lines = [f"{len(model.joint_names)} joints, tip {model.tip_link}, wrist: {model.wrist}."]
    for quantity in ("velocity", "acceleration", "jerk"):
        values = getattr(model.limits, quantity)
        missing = [
            name for name, value in zip(model.joint_names, values, strict=True) if value is None
        ]
        if missing:
            lines.append(f"- No {quantity} limit: {', '.join(missing)}")
    if model.default_limits is not None and model.default_limits.acceleration is not None:
        lines.append(f"- Missing acceleration limits: {model.default_limits.acceleration}")
    return "\n".join([lines[0], "", *lines[1:]])


def notes(model: Robot) -> str:
    """Lint and suspected pairs of a robot, in Markdown.

    Args:
        model: Model of the robot.
    """
    pairs = (f"{' and '.join(one.pair)} touch: {one.reason}" for one in model.suspected_collisions)
    return "\n".join(f"- {text}" for text in (*model.lint, *pairs))


def _choose(page: Page, name: str) -> None:
    page.workbench.choose_robot(name)
    page.rebuild()
