"""Field of requests whose answers can be kept."""

from typing import Annotated

from pydantic import Field

from armwright_wire.base import Body

#: The kept plan that an answer became.
PlanId = Annotated[
    str | None, Field(description="of the kept plan (GET /v1/plans/{id}), if it was kept")
]


class Keepable(Body):
    """A request whose answer can be kept, to be looked at or replayed later."""

    # Left out of dumps: whether an answer is kept does not change the request's hash.
    keep: bool | None = Field(
        None,
        exclude=True,
        description="keep request and answer, or problem, as a plan (GET /v1/plans); if left out, "
        "those of jobs are kept",
    )
