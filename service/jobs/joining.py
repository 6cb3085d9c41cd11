"""The answer to a batch, joined of the answers to its chunks."""

import json
import re
from collections.abc import Sequence

from pydantic_core import to_json

from service.jobs.execution import BATCH_PATH
from service.storage.job_store import JobAnswer
from service.storage.queue_store import ChunkAnswer

_JSON = "application/json"
_HEAD = b'{"results":['
_TAIL = re.compile(rb'\],"succeeded":(\d+),"failed":(\d+)\}\Z')


def joined_answer(chunks: Sequence[ChunkAnswer]) -> JobAnswer:
    """The answer to a batch, as if it had been answered as a whole.

    The results of a chunk go in as they are, without being parsed. Where a chunk as a whole has
    failed, each of its problems has.

    Args:
        chunks: The answers to its chunks, in order.
    """
    results, succeeded, failed = [], 0, 0
    for chunk in chunks:
        if chunk.has_succeeded:
            tail = _TAIL.search(chunk.content, max(len(chunk.content) - 80, 0))
            assert tail is not None
            results.append(chunk.content[len(_HEAD) : tail.start()])
            succeeded += int(tail[1])
            failed += int(tail[2])
        else:
            results.append(_failures(chunk))
            failed += chunk.size
    content = b'%s%s],"succeeded":%d,"failed":%d}'
    return JobAnswer(_JSON, content % (_HEAD, b",".join(results), succeeded, failed))


def _failures(chunk: ChunkAnswer) -> bytes:
    """The problem of a chunk, once for each of its problems."""
    problem = json.loads(chunk.content)
    indices = range(chunk.first, chunk.first + chunk.size)
    return b",".join(
        to_json(problem | {"instance": f"{BATCH_PATH}#/problems/{index}"}) for index in indices
    )
