"""Robots by name, built-in ones among them."""

import json
from importlib.resources import files
from typing import Annotated, Any, Literal

from fastapi import Query, Request, Response
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import FormData, UploadFile

from armwright_wire.robots.robot import (
    ArchiveFields,
    GeometryAnswer,
    GeometryKind,
    RobotAnswer,
    RobotBody,
    RobotChanges,
    RobotList,
    RobotSummary,
)
from kinematics.model.robot_names import builtin_names
from service.endpoints import documents
from service.endpoints.documents import After, Limit
from service.http import answers
from service.http.json_route import JsonRequest, json_router, require_json, require_plain
from service.http.state import documents_of, prepared_folder
from service.storage.caches import prepared_files
from service.storage.robot_repository import is_built_in
from service.task_references import change_robot as change_task
from service.task_references import make_robot, robot_geometry, robot_srdf, robot_urdf, unpack_robot
from service.validation import (
    ProblemError,
    parse_json,
    request_problem,
    storage_problem,
    validate_as,
)

router = json_router("robots", "/v1/robots")

_KIND = "robot"
_MAX_PARTS = 16
#: Fields of a form that are JSON, each with an example.
_OBJECTS = {
    "joint_limits": '{"joint": {"velocity": 2.0, "acceleration": 5.0}}',
    "default_limits": '{"acceleration": "10 x velocity"}',
    "held": '{"joint": 0.1}',
    "calibration": '{"origin": "measured", "joints": {"joint": {...}}}',
    "inertias": '{"origin": "identified", "links": {"link": {...}}}',
    "motors": '{"*": {"inertia": 1e-4, "gear_ratio": 100}}',
    "allow_suspected": "true",
    "visual_solids": "true",
    "tools": '[{"name": "gripper_a", "form": {"type": "parallel_jaw"}}]',
}
_BODY = json.loads(files("service.endpoints.robots").joinpath("upload.json").read_text("utf-8"))


@router.post(
    "",
    status_code=201,
    summary="Store a new robot",
    response_model=RobotAnswer,
    openapi_extra=_BODY,
)
async def create_robot(request: Request) -> Response:
    """Builds a robot from URDF, from a Denavit-Hartenberg table or from a .zip, and stores it.

    Meshes that are not convex are cut into convex pieces, which may take seconds.
    """
    content_type = request.headers.get("content-type", "")
    if content_type.split(";")[0].strip().lower() == "multipart/form-data":
        document, answer, name = await _from_form(request)
    else:
        document, answer, name = await _from_json(request, content_type)
    return await documents.create(request, _KIND, name, document, lambda _: answer)


@router.get("", summary="List robots")
async def list_robots(request: Request, after: After = "", limit: Limit = 100) -> RobotList:
    """Built-in and stored robots by name, page by page."""
    stored = [record.name for record in await documents.stored(request, _KIND, after, limit)]
    every = sorted([*stored, *(name for name in builtin_names() if name > after)])
    names, following = documents.page(every, limit, str)
    robots = [await _summary(request, name) for name in names]
    return RobotList(robots=[robot for robot in robots if robot is not None], next=following)


@router.get("/{name}", summary="Get the model of a robot", response_model=RobotAnswer)
async def get_robot(name: str, request: Request) -> Response:
    """Joints, limits, links and axes; null where a limit is not known or there is none."""
    model = await answers.model(request, name)
    return Response(model.answer, media_type="application/json")


@router.get(
    "/{name}/urdf",
    summary="The URDF of a robot",
    response_class=Response,
    responses={200: {"content": {"application/xml": {}}, "description": "The URDF."}},
)
async def get_urdf(
    name: str,
    request: Request,
    joint_limits: Annotated[
        Literal["original", "merged"],
        Query(description="merged writes the robot's limits, given beside the URDF, into it"),
    ] = "original",
) -> Response:
    """The URDF that a robot came as, or one written of its Denavit-Hartenberg table.

    Of a table gravity, motor inertias and solids other than spheres, capsules and cylinders are
    named in comments at the head of the file.
    """
    document = await answers.robot_document(request, name)
    merge = joint_limits == "merged"
    content = await answers.answer(
        request, lambda robot, _: robot_urdf.job(robot, document, merge), name
    )
    return Response(content, media_type="application/xml")


@router.get(
    "/{name}/srdf",
    summary="The SRDF of a robot",
    response_class=Response,
    responses={200: {"content": {"application/xml": {}}, "description": "The SRDF."}},
)
async def get_srdf(name: str, request: Request) -> Response:
    """An SRDF written of a robot: its chain, its named states and the pairs that may touch.

    Where the robot came without an SRDF, the pairs are those that were found when it was stored.
    """
    content = await answers.answer(request, lambda robot, _: robot_srdf.job(robot), name)
    return Response(content, media_type="application/xml")


@router.get(
    "/{name}/geometry",
    summary="Collision or visual geometry of a robot",
    response_model=GeometryAnswer,
)
async def get_geometry(
    name: str,
    request: Request,
    kind: Annotated[
        GeometryKind,
        Query(description="visual: what the robot looks like, which no proof is about"),
    ] = "collision",
    tool: Annotated[
        str | None, Query(description="built-in or stored tool that is mounted, and drawn too")
    ] = None,
) -> Response:
    """The surfaces of all links as triangles, in the frames that forward kinematics answers.

    Fine meshes are drawn by their hulls where the answer would grow beyond some megabytes; fine
    visual ones are thinned out.
    """
    content = await answers.answer(
        request,
        lambda robot, _: robot_geometry.job(robot, name, kind),
        name,
        asked={} if tool is None else {"tool": tool},
    )
    return Response(content, media_type="application/json")


@router.patch(
    "/{name}", summary="Change limits, inertias or frames of a robot", response_model=RobotAnswer
)
async def change_robot(name: str, request: Request, _body: RobotChanges) -> Response:
    """Stores a robot with other values; requests and jobs from then on see them.

    What is not named stays as it is. Meshes are not cut again.
    """
    _refuse_built_in(name)
    content = await request.body()
    store = documents_of(request)
    before = await run_in_threadpool(store.get, _KIND, name)
    job = change_task.job(before.content, content, prepared_folder(request))
    document, answer = await answers.build(request, job)
    reference = await answers.robot(request, name)
    if reference.hash != before.record.hash:
        raise storage_problem(
            "CONFLICT",
            f"robot {name!r} was replaced while it was changed",
            hint="Send the change again.",
            name=name,
        )
    record = await run_in_threadpool(store.replace, _KIND, name, document)
    if record.hash != reference.hash:
        await run_in_threadpool(prepared_files.forget, reference)
    return Response(answer, media_type="application/json")


@router.delete("/{name}", status_code=204, summary="Delete a robot")
async def delete_robot(name: str, request: Request) -> None:
    """Forgets a stored robot."""
    _refuse_built_in(name)
    reference = await answers.robot(request, name)
    await run_in_threadpool(documents_of(request).delete, _KIND, name)
    await run_in_threadpool(prepared_files.forget, reference)


# ------------------------------------------------------------------------------ from JSON


async def _from_json(request: Request, content_type: str) -> tuple[bytes, bytes, str]:
    if await request.body():
        require_json(content_type)
        require_plain(request.headers.get("content-encoding"))
    assert isinstance(request, JsonRequest)
    body = await request.read(RobotBody)
    await _check_name(request, body.name)
    job = make_robot.job(await request.body(), prepared_folder(request))
    document, answer = await answers.build(request, job)
    return document, answer, body.name


# ------------------------------------------------------------------------- from an archive


async def _from_form(request: Request) -> tuple[bytes, bytes, str]:
    async with request.form(
        max_files=1, max_fields=_MAX_PARTS, max_part_size=request.app.state.settings.max_body_size
    ) as form:
        archive, texts = _parts(form)
        fields = _form_fields(texts, archive.filename)
        await _check_name(request, fields.name)
        content = await archive.read()
    given = fields.model_dump(exclude_none=True)
    job = unpack_robot.job(content, given, prepared_folder(request))
    document, answer = await answers.build(request, job)
    return document, answer, fields.name


def _parts(form: FormData) -> tuple[UploadFile, dict[str, Any]]:
    files = [value for value in form.values() if isinstance(value, UploadFile)]
    if len(files) != 1:
        raise request_problem(
            "VALIDATION_ERROR",
            "the form holds no file: one .zip is needed",
            hint="Send the archive as a file, say in the field file, and name as a text field.",
        )
    # Forms of pages send fields that nobody filled in, too.
    return files[0], {key: value for key, value in form.items() if isinstance(value, str) and value}


def _form_fields(texts: dict[str, Any], file_name: str | None) -> ArchiveFields:
    given = {"name": (file_name or "").removesuffix(".zip")} | texts
    for name in _OBJECTS:
        text = str(given.get(name, "")).lstrip()
        # Of these what is no JSON object is the text of a YAML file.
        if name in given and (text.startswith("{") or name not in ("joint_limits", "calibration")):
            given[name] = _json_field(name, given[name])
    return validate_as(ArchiveFields, given)


def _json_field(name: str, text: str) -> Any:
    try:
        return parse_json(text.encode())
    except ProblemError as error:
        raise request_problem(
            "VALIDATION_ERROR",
            f"{name}: {error.detail}",
            hint=f"Give it as {_OBJECTS[name]}.",
        ) from None


# ---------------------------------------------------------------------------------- names


async def _check_name(request: Request, name: str) -> None:
    """Refuse a name that is taken before seconds are spent on building."""
    _refuse_built_in(name)
    try:
        await run_in_threadpool(documents_of(request).record, _KIND, name)
    except ProblemError:
        return
    raise storage_problem(
        "CONFLICT",
        f"there already is a robot named {name!r}",
        hint="Choose another name, or delete that robot.",
        name=name,
    )


def _refuse_built_in(name: str) -> None:
    if is_built_in(name):
        raise storage_problem(
            "CONFLICT",
            f"{name!r} is a built-in robot, which can't be replaced or deleted",
            hint="Choose another name.",
            name=name,
        )


async def _summary(request: Request, name: str) -> RobotSummary | None:
    try:
        model = await answers.model(request, name)
    except ProblemError as error:
        if error.code != "NOT_FOUND":  # it was deleted a moment ago
            raise
        return None
    return RobotSummary(name=name, built_in=is_built_in(name), joints=model.joints)
