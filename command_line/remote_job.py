"""Long requests to a service as jobs, whose stages a terminal shows while they run."""

from contextlib import suppress
from typing import Any

from rich.console import Console
from rich.status import Status

from armwright_client import ArmwrightError, Pending
from armwright_client.call import Call, Sender


def answer_of_job(sender: Sender, call: Call[bytes], console: Console) -> bytes:
    """The answer to a request that runs as a job; whoever interrupts it here ends it there.

    Args:
        sender: Sender of the client.
        call: The request.
        console: Console that shows the stages.

    Raises:
        ArmwrightError: The service answers a problem, or not at all.
    """
    with console.status("queued") as status:
        pending = sender.postpone(call)
        try:
            _follow(pending, status)
            return pending.wait()
        except KeyboardInterrupt:
            with suppress(ArmwrightError):  # it has ended, or nobody is there to be told
                pending.cancel()
            raise


def _follow(pending: Pending[Any], status: Status) -> None:
    """Show the stages of a job until it ends or its events do; the answer is asked for anyway."""
    with suppress(ArmwrightError):
        for event in pending.events():
            job = event.job()
            status.update(job.stage or job.status)
