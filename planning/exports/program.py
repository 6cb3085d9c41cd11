"""One program of several motions and of what the cell does between them, proved as one.

Each part is proved with what the robot holds in it, at the points that the file has. Where the arm
stands, it is proved standing at the last point of the motion before.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, typed
from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import REST, Trajectory, stay
from obstacles.robots.allowed_pairs import TOUCH_DEPTH
from obstacles.robots.finger_geometry import with_fingers
from obstacles.robots.robot_geometry import lever_arms
from obstacles.robots.tool import PART
from obstacles.scenes.scene import AllowedContact
from planning.exports import formats
from planning.exports.export import (
    RULES,
    Place,
    ProvedRun,
    allowed_lines,
    check_premises,
    language_of,
    plain,
    prove_run,
    signed,
    unproved_parts,
)
from planning.exports.languages import Language, WrittenMotion, procedure
from planning.exports.options import Event, ExportFormat, ExportOptions, Rule
from planning.exports.points import single_degrees
from planning.proof.certificate import Certificate, certify, certify_gripper
from planning.proof.premises import Premises
from planning.sequence.result import SequencePlan
from planning.sequence.world import Cells
from planning.values.deadline import Deadline
from planning.values.finger_motion import FingerMotion

#: Numbers of single precision are off by less than this, of angles of one turn [rad].
_SINGLE = 4e-7


class ProgramPart(NamedTuple):
    """A stage of a task, a leg of a tour or a whole motion.

    Args:
        label: What it is, for a comment.
        kind: Kind of the stage.
        motion: Motion from its own time 0.
        place: The robot with what it holds, its fingers as they stand at the beginning, and its
            surroundings.
        fingers: Motion of the fingers beside it; None where they stand still.
        event: What it says to the machines around; None for nothing.
        premises: Premises of the proof that it has; None where it has none.
    """

    label: str
    kind: str
    motion: Trajectory
    place: Place
    fingers: FingerMotion | None = None
    event: Event | None = None
    premises: Premises | None = None

    @property
    def stands(self) -> bool:
        """Whether the arm stands still."""
        return not self.motion.coefficients[:, :, 1:].any()


def program_parts(plan: SequencePlan) -> list[ProgramPart]:
    """The stages of a task as parts of a program.

    Args:
        plan: The stages that were planned; what touches in them may go hardly deeper.
    """
    parts, cells = list[ProgramPart](), Cells()
    for stage in plan.stages:
        world, said, fingers = stage.after, stage.event, stage.fingers
        if fingers is not None:
            world = world.with_robot(with_fingers(world.robot, fingers.first))
        contacts = {
            item.pair: AllowedContact("request", item.overlap + TOUCH_DEPTH)
            for item in stage.certificate.allowed_collisions
            if item.overlap is not None
        }
        margin = stage.certificate.premises.margin
        cell = cells.cell(world, contacts, margin)
        label = " ".join([f"{stage.index}: {stage.kind}", *filter(None, [stage.name])])
        event = None if said is None else Event(said.kind, said.port, said.value)
        place = Place(cell.robot, cell.scene, margin)
        parts.append(ProgramPart(label, stage.kind, stage.trajectory, place, fingers, event))
    return parts


@dataclass(frozen=True, slots=True)
class ProvedPart:
    """A part of a program with its proof.

    Args:
        label: What it is.
        kind: Kind of the stage.
        certificate: The proof of what the controller makes of it, with what is held in it.
    """

    label: str
    kind: str
    certificate: Certificate


@dataclass(frozen=True, slots=True)
class Program:
    """A program with what is proved of it.

    Args:
        text: The file.
        file_name: The program's name with the ending of the format.
        rule: The interpolation between its points.
        parts: The parts with their proofs, in order.
        proved: Nothing collides in any part wherever the controller keeps to the rule.
        unproved: Parts that the proof does not cover, a sentence each.
        tolerance: Tracking error of every joint that the clearance of all parts covers [rad or m].
        point_count: Number of points in the file.
        blends: How far the points may be cut, as the flange's distance [m], motion after motion.
    """

    text: str
    file_name: str
    rule: Rule
    parts: tuple[ProvedPart, ...]
    proved: bool
    unproved: tuple[str, ...]
    tolerance: float | None
    point_count: int
    blends: Array


@typed
def export_program(
    parts: Sequence[ProgramPart],
    options: ExportOptions,
    *,
    different_scene: bool = False,
    deadline: Deadline | None = None,
) -> Program:
    """Write motions with what the cell does between them as one program, and prove it.

    Args:
        parts: Parts in order; each begins where the one before ends.
        options: Format, points and program.
        different_scene: Whether robot, scene and what is held may be others than those of the
            proofs that the parts have.
        deadline: Time at which to give up the proof.

    Raises:
        InvalidOption: A robot or the number of points does not fit the format; the parts do not
            join or do not move; a name has no number; or a part was proved for something else.
    """
    formats.check_axes(parts[0].place.robot.chain, options)
    _check_joins(parts)
    rounds = options.format in (ExportFormat.RAPID, ExportFormat.KRL)
    for part in parts:
        if part.premises is not None and not different_scene:
            check_premises(part.premises, Premises.of_cell(*part.place))
    runs = [*_runs(parts, options)]
    moves = [k for k, run in enumerate(runs) if not run[0].stands]
    if not moves:
        raise InvalidOption("nothing moves: there is no program", hint="Export a motion.")
    proved: dict[int, ProvedRun] = {}
    for _ in range(2):
        for k in moves:
            own = [(part.motion, _spared(part.place, rounds)) for part in runs[k]]
            proved[k] = prove_run(own, options, deadline)
        rules = {run.points.rule for run in proved.values()}
        if len(rules) == 1:
            break
        # One reader for the whole file: it interpolates by what every motion bears.
        options = replace(options, interpolation=Rule.CUBIC.value)
    certificates: list[Certificate] = []
    for k, run in enumerate(runs):
        if k in proved:
            certificates += proved[k].certificates
            continue
        q = _written(run[0].motion.start, rounds)
        certificates.append(_certify_still(run[0], q, _spared(run[0].place, rounds), deadline))
    made = tuple(
        ProvedPart(part.label, part.kind, certificate)
        for part, certificate in zip(parts, certificates, strict=True)
    )
    is_proved = all(one.proved.collisions for one in certificates)
    known = [run.tolerance for run in proved.values() if run.tolerance is not None]
    tolerance = min(known) if len(known) == len(proved) and is_proved else None
    unproved = unproved_parts(options, certificates, program=True)
    head = _comments(options, rules.pop(), made, is_proved, (*unproved,))
    text = _text(runs, proved, options, head, tolerance)
    return Program(
        text=text,
        file_name=options.file_name,
        rule=next(iter(proved.values())).points.rule,
        parts=made,
        proved=is_proved,
        unproved=unproved,
        tolerance=tolerance,
        point_count=sum(len(run.points.ticks) for run in proved.values()),
        blends=np.concatenate([run.radii for run in proved.values()]),
    )


def _check_joins(parts: Sequence[ProgramPart]) -> None:
    for k in range(1, len(parts)):
        apart = float(np.abs(parts[k].motion.start - parts[k - 1].motion.end).max())
        # Motions that join do so to the rounding of their polynomials [rad or m].
        if apart > 1e-6:
            raise InvalidOption(
                f"{parts[k].label} begins {apart:.3g} rad from where {parts[k - 1].label} ends",
                hint="Export motions that join.",
            )


def _runs(parts: Sequence[ProgramPart], options: ExportOptions) -> Iterator[list[ProgramPart]]:
    """Parts that a controller carries out as one motion, or that stand, in order."""
    for stands, group in groupby(parts, key=lambda part: part.stands):
        if stands or not options.is_spline:
            yield from ([part] for part in group)
        else:
            yield [*group]


def _spared(place: Place, rounds: bool) -> Place:
    """A place with so much more margin as rounded joints may take what is held from where it is."""
    if not rounds:
        return place
    return place._replace(margin=place.margin + _SINGLE * float(lever_arms(place.robot).sum()))


def _written(q: Array, rounds: bool) -> Array:
    """A configuration (n,) as the file has it."""
    return np.deg2rad(single_degrees(q).astype(np.float64)) if rounds else q


def _certify_still(
    part: ProgramPart, q: Array, place: Place, deadline: Deadline | None
) -> Certificate:
    if part.fingers is not None:
        return certify_gripper(
            part.fingers, place.robot, place.scene, q, margin=place.margin, deadline=deadline
        )
    motion = stay(place.robot.chain.joint_names, q, part.motion.duration)
    return certify(motion, place.robot, place.scene, margin=place.margin, deadline=deadline)


def prove_part(part: ProgramPart, deadline: Deadline | None = None) -> Certificate:
    """The proof of a part as it was planned, not as a controller interpolates it."""
    if part.stands:
        return _certify_still(part, part.motion.start, part.place, deadline)
    robot, scene, margin = part.place
    return certify(part.motion, robot, scene, margin=margin, deadline=deadline)


def _text(
    runs: Sequence[Sequence[ProgramPart]],
    proved: dict[int, ProvedRun],
    options: ExportOptions,
    head: Sequence[str],
    tolerance: float | None,
) -> str:
    robot = runs[0][0].place.robot
    names = robot.chain.joint_names
    language: Language
    if options.format == ExportFormat.CSV:
        language = formats.Table(options, names, dict(robot.fingers.positions))
    elif options.is_spline:
        language = formats.RosSteps(options, names, tolerance)
    else:
        language = language_of(robot.chain, options)
    first = next(iter(proved.values()))
    # The way to the first point is through the surroundings of the first motion.
    lines = language.begin(first.points.positions[0], first.tolerance)
    tip = robot.chain.tip_link
    for k, run in enumerate(runs):
        chain = run[0].place.robot.chain
        told = chain.tip_link
        # A point of what is held is no tool.
        if told.partition(PART)[0] in chain.index:
            if told.partition(PART)[0] != tip.partition(PART)[0]:
                lines += language.call(procedure(told))
            tip = told
        lines += [language.note(plain(part.label)) for part in run]
        if k in proved:
            end = run[-1].motion
            rests = bool(np.abs(end.sample([end.duration], 1)).max() <= 1e-6)
            lines += language.motion(WrittenMotion(proved[k].points, proved[k].corners, rests))
        else:
            lines += _standing_lines(language, run[0], options)
    return "\n".join([*language.program(head, lines), ""])


def _standing_lines(language: Language, part: ProgramPart, options: ExportOptions) -> list[str]:
    lines: list[str] = []
    duration = part.motion.duration
    if part.fingers is not None:
        moved = {name: part.fingers.last[name] for name in sorted(part.fingers.leaders)}
        if options.gripper is None:
            return language.fingers(moved, duration)
        closes = float(part.kind == "close")
        return [*language.event(Event("signal", options.gripper, closes)),
                *language.wait(duration)]  # fmt: skip
    if part.event is not None:
        lines += language.event(part.event)
    if duration > REST and part.kind not in ("grasp", "place", "attach", "detach"):
        lines += language.wait(duration)
    return lines


def _comments(
    options: ExportOptions, rule: Rule, parts: Sequence[ProvedPart], proved: bool,
    unproved: Sequence[str],
) -> list[str]:  # fmt: skip
    lines = [f"Written by Armwright: {options.format.value}, {len(parts)} parts."]
    lines.append(f"Between the points: {RULES[rule]}.")
    lines.append(
        "PROVED free of collisions by that rule, each part with what is held in it. The arm stands "
        "at the first point, within the tolerance, when the program begins."
        if proved
        else "NOT PROVED free of collisions."
    )
    for part in parts:
        certificate, verdict = part.certificate, "proved"
        if certificate.violation is not None:
            verdict = f"NOT proved: {certificate.violation.message}"
        lines.append(f"{part.label}: {verdict}, {certificate.premises.against()}.")
    lines += [f"Not covered: {sentence}" for sentence in unproved]
    told = dict.fromkeys(line for part in parts for line in allowed_lines(part.certificate))
    return signed(options, [*lines, *told])
