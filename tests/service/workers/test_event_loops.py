"""Workers on transports that look like asyncio's and don't descend from them."""

import asyncio
from typing import Any, cast

from service.workers.fork.client import WorkerProcess
from service.workers.process import Ticket, Worker
from service.workers.task import Job, pack_job


class Foreign:
    """A transport as uvloop has them: its methods are those of asyncio's, its class is not."""

    def __init__(self) -> None:
        self.sent = b""

    def write(self, data: bytes) -> None:
        self.sent += data

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        return ("127.0.0.1", 1) if name in ("peername", "sockname") else default

    def is_closing(self) -> bool:
        return False

    def pause_reading(self) -> None:
        """Do nothing."""

    def resume_reading(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


def foreign() -> tuple[Foreign, asyncio.Transport]:
    transport = Foreign()
    return transport, cast(asyncio.Transport, transport)


def test_a_job_is_sent_on_it() -> None:
    async def scenario() -> bytes:
        worker = Worker(cast(WorkerProcess, None), lambda *_: None)
        transport, typed = foreign()
        worker.connection_made(typed)
        job: Job[Any] = Job("m:f", (1,))
        future = asyncio.get_running_loop().create_future()
        worker.send(Ticket(job, job.deadline, pack_job(job), future, None))
        return transport.sent

    assert asyncio.run(scenario()).endswith(pack_job(Job("m:f", (1,))))
