"""Programs of whole tasks, carried out by interpreters here and judged by FCL and pinocchio."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import armwright as aw
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.pose import inverse
from kinematics.trajectory.trajectory import stay
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.attachment import Attachment, hold
from planning.exports.options import PATH_FORMATS, ExportFormat, ExportOptions
from planning.exports.program import Program, ProgramPart, export_program, program_parts
from tests.planning.exports.interpreters import Do, read
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.sequence.workshop import deburring, gripping, scene, worked

STREAMS = (ExportFormat.EGM, ExportFormat.RSI)
FORMATS = [one for one in ExportFormat if one not in STREAMS]
#: What of the peg may touch something, and how deep [m].
TOUCHING = [("peg", name) for name in ("bench", "chuck_0", "chuck_1")]
DEEP = 1e-4
ARM = PinocchioArm("ur5e")


@cache
def parts() -> tuple[ProgramPart, ...]:
    """The work as the parts of a program."""
    return tuple(program_parts(worked()))


@cache
def program(format_: ExportFormat) -> Program:
    blend = 0.03 if format_ in PATH_FORMATS else 0.0
    options = ExportOptions(format_, 0.02, blend=blend, ports={"spindle": 2})
    return export_program(parts(), options)


def flange(q: Array) -> Array:
    """Pose of the flange by pinocchio, shape (4, 4)."""
    return np.asarray(ARM.pose(q, "tool0"))


class Cell:
    """The cell as it is while a program runs: it knows of no plan, only of what touches."""

    def __init__(self) -> None:
        self.robot, self.scene = gripping(), scene()
        self.held: tuple[str, Array] | None = None
        self.worst, self.states, self.carried = np.inf, 0, 0

    def do(self, one: Do, q: Array) -> None:
        """Carry out what is no motion."""
        if one.what == "take":
            assert self.held is None
            assert one.value == "take_spindle"
            self.robot = deburring()
        elif one.what == "fingers":
            closes = one.value[0] < self.robot.fingers.positions["jaw/opening"]
            self.robot = aw.with_fingers(self.robot, {"jaw/opening": float(one.value[0])})
            peg = self.scene.obstacle("peg")
            if closes:
                apart = FclWorld(self.robot, aw.Scene((peg,))).clearance(q)
                assert apart.distance < 1e-4, "the jaws close on nothing"
                self.held = "peg", inverse(flange(q)) @ peg.T_world_obstacle
            elif self.held is not None:
                put = aw.Obstacle("peg", peg.shape, flange(q) @ self.held[1])
                others = [o for o in self.scene.obstacles if o.id != "peg"]
                self.scene, self.held = aw.Scene([*others, put]), None

    def see(self, states: Array) -> None:
        """Measure all pairs in some configurations (k, n)."""
        link = self.robot.chain.link("tool0")
        grips = [("peg", name) for name in self.robot.names if name.startswith("jaw")]
        attached = []
        if self.held is not None:
            shape = self.scene.obstacle("peg").shape
            attached = [Attachment(aw.Obstacle("peg", shape, self.held[1]), link.name, ())]
            self.carried += len(states)
        for allowed, least in ((grips + TOUCHING, 0.0), (grips, -DEEP)):
            known = {*self.scene.ids, "peg", *self.robot.names}
            pairs = [pair for pair in allowed if {*pair} <= known]
            cell = hold(self.robot, self.scene, attached, pairs)
            world = FclWorld(cell.robot, cell.scene)
            for q in states:
                found = world.clearance(q)
                assert found.distance > least, (found, q.tolist())
                self.worst = min(self.worst, found.distance)
        self.states += len(states)


def cut(a: Array, c: Array, b: Array, size: float, *, radius: bool) -> Array:
    """A quadratic corner as a controller may make it, between two legs."""
    ends = []
    for end in (a, b):
        share = size
        if radius:
            at = np.linspace(0.0, 1.0, 501)
            away = [np.linalg.norm(flange(c + s * (end - c))[:3, 3] - flange(c)[:3, 3]) for s in at]
            share = float(at[np.flatnonzero(np.array(away) <= size)[-1]])
        ends.append(c + share * (end - c))
    t = np.linspace(0.0, 1.0, 6)[:, None]
    return (1 - t) ** 2 * ends[0] + 2 * t * (1 - t) * c + t**2 * ends[1]


def run(made: Program, format_: ExportFormat) -> tuple[Cell, list[Do]]:
    """Carry out a program, all states between its points checked."""
    done, cell = read(made.text, format_), Cell()
    q = done[0].q
    assert q is not None
    for k, one in enumerate(done):
        if one.q is None:
            cell.do(one, q)
            continue
        ways = np.abs(one.q - q).max()
        goes_on = k + 1 < len(done) and done[k + 1].q is not None
        if ways < 0.03 and goes_on and not one.cut and k % 4:
            q = one.q  # one of four points that are so near is looked at
            continue
        shares = np.linspace(0.0, 1.0, max(int(ways / 0.06), 1) + 1)[:, None]
        cell.see(q + shares * (one.q - q))
        if one.cut:
            after = done[k + 1].q
            assert after is not None, "a corner is cut before something else happens"
            cell.see(cut(q, one.q, after, one.cut, radius=format_ != ExportFormat.KRL))
        q = one.q
    return cell, done


@pytest.mark.parametrize("format_", FORMATS)
def test_a_program_does_the_work_and_touches_nothing(format_: ExportFormat) -> None:
    made = program(format_)
    assert made.proved, [part for part in made.parts if part.certificate.violation]
    cell, done = run(made, format_)
    assert cell.states > 150
    assert cell.carried > 30
    told = [one.what for one in done if one.q is None and one.what != "wait"]
    assert told == ["fingers", "signal", "wait_for", "fingers", "take", "set"]
    values = [one.value for one in done if one.what in ("signal", "wait_for", "set")]
    assert values == [("3", 1.0), ("1", 1.0), ("2", 0.0)]
    stands = cell.scene.obstacle("peg").T_world_obstacle[:3, 3]
    assert stands == pytest.approx([0.45, -0.25, 0.125], abs=2e-4)
    if format_ in PATH_FORMATS:
        assert sum(one.cut > 0.0 for one in done) > 10


def test_what_is_held_makes_a_program_unproved_where_it_meets_something() -> None:
    changed = list(parts())
    post = aw.Obstacle("post", aw.Cylinder(0.03, 0.6), aw.pose([0.35, 0.0, 0.4]))
    for k in range(5, 8):
        place = changed[k].place
        around = replace(place.scene, obstacles=(*place.scene.obstacles, post))
        changed[k] = changed[k]._replace(place=place._replace(scene=around))
    made = export_program(changed, ExportOptions(ExportFormat.RAPID, 0.02, blend=0.03))
    if made.proved:
        pytest.fail("the post is in the way")
    wrong = [part for part in made.parts if not part.certificate.proved.collisions]
    assert {part.kind for part in wrong} <= {"move", "lift", "approach"}
    assert "! NOT PROVED free of collisions." in made.text
    assert f"{wrong[0].label}: NOT proved" in made.text
    assert not made.blends[:2].any()


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"format": ExportFormat.URSCRIPT_MOVEJ}, "'spindle' has no number"),
        ({"format": ExportFormat.KRL, "ports": {"spindle": 0}}, "from 1 on"),
    ],
)
def test_ports_without_numbers_are_refused(options: dict[str, object], told: str) -> None:
    with pytest.raises(InvalidOption, match=told):
        export_program(parts(), ExportOptions(**options))  # type: ignore[arg-type]


@pytest.mark.parametrize("format_", STREAMS)
def test_a_stream_has_waits_and_nothing_else_beside_positions(format_: ExportFormat) -> None:
    with pytest.raises(InvalidOption, match=f"{format_.value} streams positions alone"):
        export_program(parts(), ExportOptions(format_))
    moves = [part for part in parts() if part.event is None and part.fingers is None][:1]
    end = moves[0].motion.end
    dwell = stay(moves[0].motion.joint_names, end, 0.5)
    made = export_program([*moves, moves[0]._replace(motion=dwell)], ExportOptions(format_))
    rows = np.array([one.q for one in read(made.text, format_)])
    still = np.abs(rows - end).max(axis=1) < 1e-7
    assert np.count_nonzero(still) == pytest.approx(0.5 / ExportOptions(format_).period, abs=2)


def test_parts_that_do_not_join_are_refused() -> None:
    with pytest.raises(InvalidOption, match="from where 0: move ends"):
        export_program((parts()[0], parts()[5]), ExportOptions(ExportFormat.CSV))


def test_a_gripper_of_an_output_is_switched_and_waited_for() -> None:
    options = ExportOptions(ExportFormat.URSCRIPT_MOVEJ, 0.02, ports={"spindle": 2}, gripper=5)
    text = export_program(parts(), options).text
    assert "gripper_to(" not in text.split("def armwright")[1]
    assert text.index("set_standard_digital_out(5, True)\n  sleep(1.59375)") < text.index(
        "set_standard_digital_out(5, False)\n  sleep(1.59375)"
    )
