"""The functions that workers run for requests: values in, values out, nothing of HTTP."""

from service import translate
from service.schemas.scene import Scene


def check_scene(document: bytes) -> str:
    """Build a scene from its JSON document to see that it can be built.

    Returns:
        The content hash of the scene.

    Raises:
        InvalidScene: It can't be built; the message names the obstacle.
    """
    return translate.scene(Scene.model_validate_json(document)).content_hash
