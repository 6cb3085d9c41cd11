"""Kept plans: requests with their answers, replays, and bundles for other installations."""

from datetime import datetime
from typing import Any, Literal

from armwright_client.base import Answer, Options, Request
from armwright_client.problem import Problem


class DocumentName(Answer):
    """A robot or scene of a kept plan.

    Args:
        name: Of the robot or scene.
        hash: SHA-256 of its document; None for a built-in robot.
    """

    name: str
    hash: str | None = None


class KeptPlanSummary(Answer):
    """A kept request, without its content.

    Args:
        id: To ask for it by.
        operation: The request, as "POST /v1/plan".
        status: "succeeded" or "failed".
        code: Of the problem, once failed.
        robot: The robot, if the request is about one.
        scene: The stored scene, if the request names one.
        seed: Of the request.
        version: Of the service that answered.
        digest: SHA-256 of the answer without measured times.
        created: When it was answered.
        expires: When the service forgets it.
        job: The job that it answered.
        replay_of: The kept plan that it repeats or changes.
        proved_here: Whether the service came to the answer itself, and all it says is proved.
    """

    id: str
    operation: str
    status: str
    code: str | None = None
    robot: DocumentName | None = None
    scene: DocumentName | None = None
    seed: int | None = None
    version: str
    digest: str
    created: datetime
    expires: datetime
    job: str | None = None
    replay_of: str | None = None
    proved_here: bool = False


class KeptPlan(KeptPlanSummary):
    """A kept request with its answer or problem.

    Args:
        request: The body as it was sent.
        answer: Once succeeded, as JSON has it.
        problem: Once failed.
    """

    request: Any
    answer: Any = None
    problem: Problem | None = None


class PlanList(Answer):
    """Kept plans without their content, newest first.

    Args:
        plans: A page of them.
        next: To be given as `after` for the next page, if there is one.
    """

    plans: list[KeptPlanSummary]
    next: str | None = None


class ReplayRequest(Request):
    """A kept plan to be computed again, perhaps with changes.

    Args:
        changes: Fields that replace those of the request, a JSON merge patch (RFC 7396).
        documents: "kept": robot and scene as they were; "current": as they are stored now.
        keep_replay: Whether the replay is kept as a plan too.
    """

    changes: Options | None = None
    documents: Literal["kept", "current"] = "kept"
    keep_replay: bool | None = None


class ReplayAnswer(Answer):
    """The replay of a kept plan, compared with what was kept.

    Args:
        same: Whether the answers are equal but for measured times.
        differences: JSON pointers of the first values that differ.
        digest: Of the replay's answer.
        plan_id: The replay as a kept plan, if it was kept.
        answer: Of the request, as JSON has it, if it has one.
        problem: If it has none.
    """

    same: bool
    differences: list[str]
    digest: str
    plan_id: str | None = None
    answer: Any = None
    problem: Problem | None = None


class Bundle(Request):
    """A kept plan as a file: all that another installation needs to replay it.

    Args:
        armwright_bundle: Version of the format.
        operation: The request, as "POST /v1/plan".
        version: Of the service that answered.
        status: "succeeded" or "failed".
        seed: Of the request.
        digest: SHA-256 of the answer without measured times.
        robot: Its name.
        robot_document: The stored robot, JSON; None for a built-in one.
        scene: The name of the stored scene.
        scene_document: The stored scene, JSON.
        request: The body, JSON.
        answer: The answer or problem, JSON.
    """

    armwright_bundle: Literal[1] = 1
    operation: str
    version: str
    status: Literal["succeeded", "failed"]
    seed: int | None = None
    digest: str
    robot: str | None = None
    robot_document: str | None = None
    scene: str | None = None
    scene_document: str | None = None
    request: str
    answer: str
