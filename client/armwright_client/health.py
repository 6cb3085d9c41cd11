"""The state of the service."""

from armwright_wire.base import Answer


class Health(Answer):
    """That the service answers."""

    status: str
    version: str | None = None


class Readiness(Health):
    """That work can be sent.

    Args:
        workers: Processes that live.
        busy: Workers that have a job.
        waiting: Jobs that wait for a worker.
    """

    workers: int | None = None
    busy: int | None = None
    waiting: int | None = None
