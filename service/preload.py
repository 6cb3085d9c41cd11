"""Imported once by the fork server, so that every worker starts with all this already loaded.

Nothing else may import it: it sets up the process for single-threaded work.
"""

import logging
import os

for _variable in ("OMP", "OPENBLAS", "MKL", "NUMBA", "VECLIB_MAXIMUM"):
    # One job a process, one process a core: threads inside would only get in each other's way.
    os.environ[f"{_variable}_NUM_THREADS"] = "1"

from service import check_tasks, kinematics_tasks, plan_tasks, tasks, warm  # noqa: E402, F401

try:
    warm.warm_kernels()
except Exception:
    # Each worker warms itself as well and reports what is wrong; here it would end the fork server.
    logging.getLogger(__name__).exception("kernels could not be warmed")
