"""Recipe of the service's fork server, by names, so that the server imports nothing of it."""

from service.task_references import MODULES
from service.workers.fork.launch import Recipe

#: Ready once every kernel is loaded; what first requests would still compute comes after that.
RECIPE = Recipe(
    modules=MODULES,
    warm="service.warm_up.kernels:prepare",
    enrich="service.warm_up.kernels:enrich",
)
