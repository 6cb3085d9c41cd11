"""Answers computed in this process, by the tasks that a service's workers run."""

import json
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any, Literal

import platformdirs
from rich.console import Console

from armwright.first_use import compile_at_first_use
from armwright_wire import base
from armwright_wire.robots.robot import RobotBody
from armwright_wire.scenes.scene import ProjectRequest, Scene
from armwright_wire.scenes.tool import BUILTIN_TOOLS
from command_line.added_robots import added, folder, keep
from command_line.backends.endpoints import Endpoint, answering
from command_line.parameters import RobotSource
from command_line.robot_files import is_file, robot_document
from compiled.kept_file import make_private
from kinematics.errors import ArmwrightError
from kinematics.robots import builtin_names
from obstacles.collision.kept_robot import keep_robot
from obstacles.robots.robot_geometry import RobotGeometry
from planning.values.deadline import Deadline
from service.storage.caches import prepared_files, worker_cache
from service.storage.caches.cache_key import NotPrepared, Reference, builtin_reference
from service.storage.caches.mounts import mount_of, robot_tools
from service.validation import ProblemError, validate_as
from service.workers import current
from service.workers.result import PlanOutcome, TaskProblem

#: Package of the tasks; a wheel has it, as that of the models, at a longer name.
_TASKS = "service.endpoints"
#: Prepared robots of files take up to this many bytes of the user's cache.
_CACHE_BYTES = 512 * 2**20
#: The first attempt may find that a robot is not prepared.
_ATTEMPTS = 2
#: The name of a scene that is prepared for one command.
_SCENE = "scene"
#: Deadline of a request that names none [s]: that of a service without settings.
DEFAULT_TIMEOUT = 10.0
#: Scenes that are listed at most.
_MAX_SCENES = 1_000


def cache_folder() -> Path:
    """Folder of the robots that commands prepared from files."""
    return platformdirs.user_cache_path("armwright") / "command_line"


class LocalBackend:
    """Backend in this process: robots by name or from files, answers by `service.endpoints`."""

    def __init__(self) -> None:
        self._folder = cache_folder()
        compile_at_first_use()
        self._references: dict[str, Reference] = {}
        self._documents: dict[str, bytes] = {}

    def robot_name(self, source: RobotSource) -> str:
        """The name that requests call a robot by.

        Raises:
            ProblemError: There is no such robot or file, or the file is malformed.
        """
        if source.robot in builtin_names():
            keep_robot(worker_cache.robot(builtin_reference(source.robot)).geometry)
            return source.robot
        kept = added(source.robot)
        if kept is not None:
            source = source._replace(robot=str(kept))
        elif not is_file(source):
            raise ProblemError(
                "NOT_FOUND",
                f"there is neither a built-in robot nor a file {source.robot!r}",
                hint=f"Built in are: {', '.join(builtin_names())}. "
                "`armwright robots add` adds others.",
            )
        body = validate_as(RobotBody, robot_document(source))
        return self.add_robot(body.name, body.model_dump_json(exclude_none=True).encode())

    def add_robot(self, name: str, document: bytes) -> str:
        """Take a robot by its document, as services store it.

        Args:
            name: The name of the robot.
            document: JSON.
        """
        digest = prepared_files.document_hash(document)
        make_private(self._folder)
        self._references[name] = Reference("robot", name, digest, str(self._folder))
        self._documents[name] = document
        return name

    def geometry(self, robot: str) -> RobotGeometry:
        """A robot with its collision geometry.

        Args:
            robot: Name of the robot.
        """
        self.robot_model(robot)
        return worker_cache.robot(self._reference(robot)).geometry

    def projections(self, scene: dict[str, Any], body: dict[str, Any]) -> bytes:
        """The projections of points onto the obstacles of a scene.

        Args:
            scene: Scene as the API takes it.
            body: The request of ``POST /v1/scenes/{name}/project``.

        Raises:
            ProblemError: The scene or the request does not have the right form.
            InvalidScene: The scene can't be built.
        """
        from service.endpoints.check.task import project  # noqa: PLC0415

        validate_as(Scene, scene)
        validate_as(ProjectRequest, body)
        with self._stored(scene, _SCENE) as reference:
            return bytes(self._run(project, [reference, json.dumps(body).encode()]))

    def page(
        self, robot: str, plan: dict[str, Any], scene: dict[str, Any] | None, *, tree: bool = False
    ) -> bytes:
        """The HTML page of a kept plan, whose request is answered here to see what is proved.

        Args:
            robot: The name of the robot.
            plan: Stored plan as ``GET /v1/plans/{id}`` answers it; without an answer it gets that
                of here.
            scene: Scene that the request names, with this name; None where it names none.
            tree: Whether to draw the tree or roadmap of the last planner.

        Raises:
            ArmwrightError: The request is at fault, so that nothing of it can be drawn.
        """
        from service.endpoints.plans.view import view  # noqa: PLC0415

        with self._place(scene) as reference:
            content = json.dumps(self._proved(robot, reference, plan)).encode()
            mount = mount_of(plan["request"], partial(self._tool, robot))
            shown = replace(self._reference(robot), mount=mount)
            return bytes(self._run(view, [shown, reference, content, tree]))

    def replay(
        self,
        robot: str,
        plan: dict[str, Any],
        scene: dict[str, Any] | None,
        changes: dict[str, Any],
    ) -> dict[str, Any]:
        """The comparison of a kept answer with that of here, as ``replay`` of a service answers it.

        Args:
            robot: The name of the robot.
            plan: Stored plan as ``GET /v1/plans/{id}`` answers it.
            scene: Scene that the request names, with this name; None where it names none.
            changes: Merge patch of the request.

        Raises:
            ProblemError: The file has no answer, or nothing was computed.
        """
        from service.endpoints.plans.replay import answering_problem, merge  # noqa: PLC0415
        from service.http.keeping import compared  # noqa: PLC0415

        told = plan.get("answer") or plan.get("problem")
        if not told:
            raise ProblemError(
                "VALIDATION_ERROR",
                "the file has no request with its answer, so that nothing can be compared",
                hint="Give a bundle, a kept plan, or the file that `--whole` wrote.",
            )
        path = plan["operation"].removeprefix("POST ")
        request = {name: value for name, value in plan["request"].items() if name != "keep"}
        with self._place(scene) as reference:
            try:
                own = self._answer(answering(path), robot, reference, merge(request, changes))
                field = "answer"
            except (ProblemError, ArmwrightError) as error:
                own, field = answering_problem(error, path), "problem"
        same = compared(json.dumps(told).encode(), own)
        return same._asdict() | {"plan_id": None, field: json.loads(own)}

    def _place(self, scene: dict[str, Any] | None) -> AbstractContextManager[Reference | None]:
        """The scene that a kept request names, stored for as long as the block lasts."""
        return nullcontext() if scene is None else self._stored(scene, scene["name"])

    def _proved(self, robot: str, scene: Reference | None, plan: dict[str, Any]) -> dict[str, Any]:
        """A kept plan that is proved here where the answer of here is its own."""
        from service.http.keeping import (  # noqa: PLC0415
            answer_digest,
            named_robot,
            states_proof,
        )

        path = plan["operation"].removeprefix("POST ")
        asked = {name: value for name, value in plan["request"].items() if name != "keep"}
        told, unproved = plan.get("answer"), plan | {"proved_here": False}
        if plan.get("problem") or named_robot(path, asked) != robot:
            return unproved
        try:
            own = self._answer(answering(path), robot, scene, asked)
        except (ProblemError, ArmwrightError):
            if not told:
                raise
            return unproved
        if told and answer_digest(json.dumps(told).encode()) != answer_digest(own):
            return unproved
        return plan | {"answer": json.loads(own), "proved_here": states_proof(path, own)}

    @contextmanager
    def _stored(self, scene: dict[str, Any], name: str) -> Iterator[Reference]:
        """A scene as a service stores it, for as long as the block lasts."""
        from service.endpoints.robots.task import make_scene  # noqa: PLC0415

        make_private(self._folder)
        folder = str(self._folder)
        body = {key: value for key, value in scene.items() if key != "name"}
        document = make_scene(json.dumps(body).encode(), folder, name)
        reference = Reference("scene", name, prepared_files.document_hash(document), folder)
        try:
            yield reference
        finally:
            prepared_files.forget(reference)

    def robot_model(self, name: str) -> dict[str, Any]:
        """The model of a robot, as ``GET /v1/robots/{name}`` answers it."""
        from service.endpoints.robots.task import robot_model  # noqa: PLC0415

        model = self._run(robot_model, [self._reference(name)])
        return dict(json.loads(model.answer))

    def equations(self, robot: str, notation: Literal["latex", "text"], axes: list[str]) -> bytes:
        """The formulas of a robot."""
        from service.endpoints.dynamics.equations import equations  # noqa: PLC0415

        arguments = [self._reference(robot), self._documents.get(robot), notation, tuple(axes)]
        return bytes(self._run(equations, arguments))

    def robot_names(self) -> list[dict[str, Any]]:
        """Summaries of the built-in robots, and of those that were added on this machine."""
        paths = sorted(folder().glob("*.json"))
        others = [self.robot_name(RobotSource(path.stem)) for path in paths]
        models = (self.robot_model(name) for name in (*builtin_names(), *others))
        return [
            {
                "name": model["name"],
                "built_in": model["name"] in builtin_names(),
                "joints": len(model["joint_names"]),
            }
            for model in models
        ]

    def keep_robot(self, document: dict[str, Any]) -> str:
        """Keep a robot on this machine, once it can be read; gives where.

        Raises:
            ProblemError: The name is taken, or the robot is malformed.
        """
        body = validate_as(RobotBody, document)
        self.add_robot(body.name, body.model_dump_json(exclude_none=True).encode())
        self.robot_model(body.name)
        return str(keep(document))

    def forget_robot(self, name: str) -> None:
        """Forget a robot that was added on this machine.

        Raises:
            ProblemError: There is none of this name.
        """
        path = added(name)
        if path is None:
            raise ProblemError("NOT_FOUND", f"no robot {name!r} was added on this machine")
        path.unlink()

    def scenes(self) -> list[dict[str, Any]]:
        """Summaries of the scenes in the data folder of this user's service."""
        from service.settings import Settings  # noqa: PLC0415  long
        from service.storage.store import open_store  # noqa: PLC0415  a database

        settings = Settings()
        if settings.database_url is None and not (settings.data_dir / "armwright.db").is_file():
            return []
        store = open_store(settings.storage_url)
        try:
            records = store.documents.list("scene", "", _MAX_SCENES)
        finally:
            store.close()
        return [
            {"name": record.name, "version": record.version, "hash": record.hash}
            for record in records
        ]

    def answer(self, endpoint: Endpoint, robot: str | None, body: dict[str, Any]) -> bytes:
        """The answer to a request, computed here.

        Args:
            endpoint: Endpoint of the request.
            robot: Name of the robot, if there is one.
            body: The request.

        Raises:
            ProblemError: The request does not have the right form, or has no answer.
            ArmwrightError: The request is at fault.
        """
        named = (body["plan"]["request"] if "plan" in body else body).get("scene")
        if isinstance(named, str):
            raise ProblemError(
                "NOT_FOUND",
                f"there is no scene file {named!r}",
                hint="Give a JSON or MoveIt YAML file (--scene); names are those of a service "
                "(--url).",
            )
        return self._answer(endpoint, robot, None, body)

    def _answer(
        self,
        endpoint: Endpoint,
        robot: str | None,
        scene: Reference | None,
        body: dict[str, Any],
    ) -> bytes:
        """The answer to a request that may name a scene, which is prepared."""
        validate_as(_load(f"{base.__package__}.{endpoint.model}"), body)
        task = _load(f"{_TASKS}.{endpoint.task}")
        found = None if robot is None else self._reference(robot)
        kept = body.get("plan")
        asked = kept["request"] if isinstance(kept, dict) else body
        mounted = found and replace(found, mount=mount_of(asked, partial(self._tool, robot)))
        given = {"robot": mounted, "scene": scene, "content": json.dumps(body).encode()}
        arguments = [given[name] for name in signature(task.function).parameters if name in given]
        seconds = body.get("timeout") or DEFAULT_TIMEOUT
        with Console(stderr=True).status("starting") as status:
            current.begin(Deadline.after(seconds), lambda _, stage: status.update(stage))
            try:
                result = self._run(task, arguments)
            finally:
                current.end()
        return result.content if isinstance(result, PlanOutcome) else bytes(result)

    def close(self) -> None:
        """Keep the cache of prepared robots small."""
        if self._references:
            prepared_files.trim(str(self._folder), _CACHE_BYTES)

    def _tool(self, robot: str | None, name: str) -> bytes:
        """Document of a tool that a robot is kept with."""
        own = robot_tools(self._documents.get(robot or "", b"{}")).get(name)
        if own is None:
            raise ProblemError(
                "NOT_FOUND",
                f"there is no built-in tool, none of the robot and no tool file {name!r}",
                hint=f"Give a JSON file, or one of {', '.join(BUILTIN_TOOLS)}; other names are "
                "those of a service (--url).",
            )
        return own

    def _reference(self, name: str) -> Reference:
        return self._references.get(name) or builtin_reference(name)

    def _run(self, task: Any, arguments: list[Any]) -> Any:
        """The result of a task, once the robot that it names is prepared."""
        from service.endpoints.robots.task import prepare_robot  # noqa: PLC0415

        for _ in range(_ATTEMPTS):
            try:
                result = task(*arguments)
            except NotPrepared as error:
                reference = error.reference
                prepare_robot(self._documents[reference.name], reference.folder)
                continue
            if isinstance(result, TaskProblem):
                raise result.error
            return result
        raise ProblemError("CRASH", f"the robot {reference.name!r} can't be prepared")


def _load(name: str) -> Any:
    """The object of a name ``"module:attribute"``."""
    module, _, attribute = name.partition(":")
    return getattr(import_module(module), attribute)
