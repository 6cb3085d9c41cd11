"""The same request is answered alike, however busy the workers are and whichever takes it."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import httpx
import pytest

from benchmarks.determinism import ask
from benchmarks.determinism_requests import PATIENT

#: Enough that each worker answers several times with the other one busy; `benchmarks.determinism`
#: asks more often.
_REPEATS = 8
#: Clients at a time, for two workers.
_CLIENTS = 4
#: Takes a second for each answer, and is of a kind with others; the benchmark asks for it too.
_DEAR = "fmt"


@pytest.mark.parametrize("kind", sorted(PATIENT.keys() - {_DEAR}))
def test_answers_under_load_are_one(client: httpx.Client, kind: str) -> None:
    with ThreadPoolExecutor(_CLIENTS) as pool:
        answers = set(pool.map(partial(ask, client), [PATIENT[kind]] * _REPEATS))
    assert len(answers) == 1
    (told,) = answers
    assert told.code == "SUCCESS"
    assert not told.flagged
