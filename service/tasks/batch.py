"""The problems of a batch, separated in a worker: a batch may be megabytes."""

from service.schemas.batch import BatchRequest
from service.schemas.scene import NamedScene, Scene
from service.storage import prepared_files
from service.tasks import robots
from service.tasks.result import BatchItem
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
