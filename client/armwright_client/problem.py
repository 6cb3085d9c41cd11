"""Problem documents (RFC 9457) of the service, or of what stands before it."""

from armwright_wire import job


class Problem(job.Problem):
    """A problem document, perhaps somebody else's, of which any field may be missing."""

    type: str = "about:blank"
    title: str = ""
    status: int | None = None  # type: ignore[assignment]
    detail: str = ""
    instance: str = ""
    code: str = ""
