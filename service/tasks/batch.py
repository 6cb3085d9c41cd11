"""The problems of a batch, separated in a worker: a batch may be megabytes."""

from pydantic_core import to_json

from service.schemas.batch import BatchRequest
from service.schemas.scene import NamedScene, Scene
from service.storage import prepared_files
from service.tasks import robots
from service.tasks.chunk_sizes import Pace, chunk_sizes
from service.tasks.result import BatchItem, BatchPart
from service.workers.task import task


@task
def split(content: bytes, folder: str, name: str) -> tuple[tuple[BatchItem, ...], str | None]:
    """The problems of a batch; a scene that it gives inline is built and kept for all workers.

    Args:
        content: The request.
        folder: Where to keep the scene.
        name: For the scene, different from that of any that is stored.

    Returns:
        The problems in order, and the hash of the scene's document if there is one.

    Raises:
        InvalidScene: The scene can't be built.
    """
    body = BatchRequest.model_validate_json(content)
    shared = None
    if isinstance(body.scene, Scene):
        frame = body.scene.frame or getattr(body, "frame", None)
        named = NamedScene.model_validate({**body.scene.__dict__, "name": name, "frame": frame})
        document = named.model_dump_json(exclude_none=True).encode()
        robots.prepare_scene(document, folder, name)
        shared = prepared_files.document_hash(document)
    items = tuple(_item(body, index, shared) for index in range(len(body.problems)))
    return items, shared


@task
def cut(content: bytes, pace: Pace) -> tuple[BatchPart, ...]:
    """The parts of a batch that agents answer apart, each with all that it needs.

    Args:
        content: The request.
        pace: Speed of the agents.
    """
    body = BatchRequest.model_validate_json(content)
    scene = body.scene if isinstance(body.scene, Scene) else None
    head = _scene_fields(scene, getattr(body, "frame", None))
    parts, first = [], 0
    for size in chunk_sizes(len(body.problems), pace):
        of_part = range(first, first + size)
        problems = b",".join(_problem(body, index, scene) for index in of_part)
        parts.append(BatchPart(first, size, b'{%s"problems":[%s]}' % (head, problems)))
        first += size
    return tuple(parts)


def _scene_fields(scene: Scene | None, frame: str | None) -> bytes:
    """The fields of a scene that all problems share, JSON, each with a comma behind it."""
    if scene is None:
        return b""
    fields = b'"scene":%s,' % scene.model_dump_json(exclude_unset=True).encode()
    return fields if frame is None else fields + b'"frame":%s,' % to_json(frame)


def _problem(body: BatchRequest, index: int, shared: Scene | None) -> bytes:
    """A problem as a request of its own, but for a scene that it shares."""
    uses_shared = shared is not None and body.problems[index].scene is None
    problem = body.plan_request(index, **({"scene": None} if uses_shared else {}))
    return problem.model_dump_json(exclude_unset=True).encode()


def _item(body: BatchRequest, index: int, shared: str | None) -> BatchItem:
    uses_shared = shared is not None and body.problems[index].scene is None
    problem = body.plan_request(index, **({"scene": None} if uses_shared else {}))
    return BatchItem(
        problem.robot,
        problem.scene if isinstance(problem.scene, str) else None,
        uses_shared,
        problem.timeout,
        problem.model_dump_json(exclude_unset=True).encode(),
    )
