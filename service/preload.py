"""Imported once by the fork server, so that every worker starts with all this already loaded.

Nothing else may import it: it sets up the process for single-threaded work.
"""

import atexit
import logging
import os
import signal
from types import FrameType

#: How often the fork server looks whether its server is still there while it loads [s].
_PERIOD = 0.2
_SERVER = os.getppid()


def _leave_with_server(_number: int, _frame: FrameType | None) -> None:
    # Loading and compiling can take long, and until then nothing else would end this process.
    if os.getppid() != _SERVER:
        os._exit(1)


signal.signal(signal.SIGALRM, _leave_with_server)
signal.setitimer(signal.ITIMER_REAL, _PERIOD, _PERIOD)

for _variable in ("OMP", "OPENBLAS", "MKL", "NUMBA", "VECLIB_MAXIMUM"):
    # One job a process, one process a core: threads inside would only get in each other's way.
    os.environ[f"{_variable}_NUM_THREADS"] = "1"

# Taking compiled kernels apart one by one takes seconds, and nothing here needs to be put away.
atexit.register(os._exit, 0)

from service import tasks, warm  # noqa: E402
from service.workers.task import load_tasks  # noqa: E402

load_tasks(tasks.__name__)
try:
    warm.warm_kernels()
except Exception:
    # Each worker warms itself as well and reports what is wrong; here it would end the fork server.
    logging.getLogger(__name__).exception("kernels could not be warmed")
finally:
    # From here on it waits for the server's requests and notices by itself.
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
