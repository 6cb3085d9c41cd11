"""Files for controllers: of a motion one, of a task or tour an archive of one each motion."""

import io
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from armwright_client import Client, FramedPose, Obstacle, Scene, TaskStageReport, TimedTrajectory
from armwright_wire.motions.export import Format as ExportFormat
from armwright_wire.motions.trajectory import SegmentAnswer
from studio.requests import plan_request, set_fields, tour_request
from studio.state import Planned, TaskPlanned, TourPlanned

#: Settings of a plan that its export takes as well.
_OPTIONS = ("scene", "attached", "margin", "fingers", "allowed_collisions")
#: A stage that moves no joint by more than this stands still [rad or m].
_STILL = 1e-9


@dataclass(frozen=True, slots=True)
class ExportFile:
    """A file to be saved.

    Args:
        name: Name of the file.
        content: Bytes of the file.
    """

    name: str
    content: bytes


def export_file(
    client: Client, outcome: Planned | TaskPlanned | TourPlanned, file_format: ExportFormat
) -> ExportFile:
    """A plan as a file for a controller, proved as the controller moves.

    Args:
        client: Client that asks the service.
        outcome: A motion, or the motions of a task or tour.
        file_format: Format of the file, or of those in the archive.

    Raises:
        ApiError: The service refuses it.
    """
    if isinstance(outcome, TaskPlanned):
        return _archive(client, outcome, file_format)
    if isinstance(outcome, TourPlanned):
        return _legs(client, outcome, file_format)
    fields = set_fields(plan_request(outcome.state))
    options = {name: value for name, value in fields.items() if name in _OPTIONS}
    options["premises"] = outcome.plan.certificate.premises
    made = client.export(outcome.state.robot, outcome.plan.trajectory, file_format, **options)
    return ExportFile(made.file_name, made.content.encode())


def _archive(client: Client, outcome: TaskPlanned, file_format: ExportFormat) -> ExportFile:
    """Each motion from rest to rest in a file, in order; what the gripper does is in none.

    Stages that the arm passes without resting are one motion: no controller could begin with the
    second. It is proved with the pairs that may touch in all of them.
    """
    margin: dict[str, Any] = {
        name: value for name, value in outcome.state.settings.items() if name == "margin"
    }
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
        for stages in _motions(outcome.plan.stages):
            first, last = stages[0], stages[-1]
            # Stages that are passed are proved with other pairs each.
            known: dict[str, Any] = {}
            if first is last:
                known["premises"] = first.certificate.premises
            made = client.export(
                outcome.state.robot,
                _joined([stage.trajectory for stage in stages]),
                file_format,
                scene=Scene(obstacles=_places(outcome, first)),
                attached=first.after.as_options()["attached"],
                allowed_collisions=_allowed_in_all(stages),
                fingers=_fingers_before(outcome, first),
                **margin,
                **known,
            )
            numbers = f"{first.index:02}" + (f"-{last.index:02}" if last is not first else "")
            archive.writestr(f"{numbers}_{first.kind}_{made.file_name}", made.content)
    return ExportFile(f"task_{file_format}.zip", held.getvalue())


def _motions(stages: Sequence[TaskStageReport]) -> list[list[TaskStageReport]]:
    """Stages that move the arm, those together that it passes without resting."""
    groups: list[list[TaskStageReport]] = []
    goes_on = False
    for stage in stages:
        if goes_on:
            groups[-1].append(stage)
        elif stage.passes or _moves(stage):
            groups.append([stage])
        goes_on = stage.passes
    return groups


def _joined(parts: Sequence[TimedTrajectory]) -> TimedTrajectory:
    """Motions in turn as one."""
    segments: list[SegmentAnswer] = []
    begin = 0.0
    for part in parts:
        segments += [
            item.model_copy(update={"t0": begin + item.t0, "t1": begin + item.t1})
            for item in part.segments
        ]
        begin += part.duration
    return parts[0].model_copy(update={"duration": begin, "segments": segments})


#: Who allows pairs beside the robot itself and what is attached to it, which the export knows.
_ALLOWED_BY = frozenset({"request", "scene", "support", "touch_links"})


def _allowed_in_all(stages: Sequence[TaskStageReport]) -> list[tuple[str, str]]:
    """Pairs that may touch in every stage, whoever lets them but the robot itself."""
    first, *others = (
        {item.pair for item in stage.certificate.allowed_collisions if item.reason in _ALLOWED_BY}
        for stage in stages
    )
    return sorted(first.intersection(*others))


def _fingers_before(outcome: TaskPlanned, stage: TaskStageReport) -> dict[str, float]:
    """Positions of the gripper's joints when a stage begins [rad or m]."""
    if stage.index == 0:
        return dict(outcome.state.fingers)
    return outcome.plan.stages[stage.index - 1].after.fingers


def _legs(client: Client, outcome: TourPlanned, file_format: ExportFormat) -> ExportFile:
    """Each leg in a file, in order; all are from rest to rest."""
    fields = set_fields(tour_request(outcome.state))
    options = {name: value for name, value in fields.items() if name in _OPTIONS}
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
        for number, leg in enumerate(outcome.plan.legs):
            options["premises"] = leg.certificate.premises
            made = client.export(outcome.state.robot, leg.trajectory, file_format, **options)
            archive.writestr(f"{number:02}_leg_{made.file_name}", made.content)
    return ExportFile(f"tour_{file_format}.zip", held.getvalue())


def _moves(stage: TaskStageReport) -> bool:
    first = stage.trajectory.sample([0.0, 0.5 * stage.trajectory.duration])
    return any(abs(a - b) > _STILL for a, b in zip(*first, strict=True))


def _places(outcome: TaskPlanned, stage: TaskStageReport) -> list[Obstacle]:
    """The obstacles where they stand in a stage."""
    moved = {
        item.id: FramedPose.model_validate(item.pose.model_dump()) for item in stage.after.objects
    }
    return [
        item.model_copy(update={"pose": moved[item.id]}) if item.id in moved else item
        for item in outcome.state.obstacles
    ]
