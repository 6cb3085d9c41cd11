"""The problems of a batch, separated in a worker: a batch may be megabytes."""

from dataclasses import dataclass

from service.schemas.batch import BatchRequest
from service.schemas.scene import NamedScene, Scene
from service.storage import disk_cache
from service.tasks import robots
from service.workers.task import task


@dataclass(frozen=True, slots=True)
class Item:
    """One problem of a batch.

    Args:
        robot: Its name.
        scene: The name of a stored scene, if it is in one.
        shared: Whether it is in the scene that the batch gives inline.
        timeout: As the request names it [s].
        content: The request for its plan, JSON.
    """

    robot: str
    scene: str | None
    shared: bool
    timeout: float | None
    content: bytes


@task
def split(content: bytes, folder: str, name: str) -> tuple[tuple[Item, ...], str | None]:
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
        named = NamedScene.model_validate({**body.scene.__dict__, "name": name})
        document = named.model_dump_json(exclude_none=True).encode()
        robots.prepare_scene(document, folder, name)
        shared = disk_cache.document_hash(document)
    items = tuple(_item(body, index, shared) for index in range(len(body.problems)))
    return items, shared


def _item(body: BatchRequest, index: int, shared: str | None) -> Item:
    uses_shared = shared is not None and body.problems[index].scene is None
    problem = body.plan_request(index, **({"scene": None} if uses_shared else {}))
    return Item(
        problem.robot,
        problem.scene if isinstance(problem.scene, str) else None,
        uses_shared,
        problem.timeout,
        problem.model_dump_json(exclude_unset=True).encode(),
    )
