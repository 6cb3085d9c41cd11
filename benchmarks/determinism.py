"""Twenty answers to the same request of each kind, of a server whose machine is busy.

``python -m benchmarks.determinism --repeats 20 --busy 8`` starts servers of its own, one after the
other, each with other hash seeds, and as many busy processes beside them. Four clients ask for all
kinds of `benchmarks.determinism_requests` in random order. Answers are compared but for the times
in them. Ends with 1 if two answers to a request differ, unless each says that time ended a search:
by ``reproducibility.deterministic``, or by being ``TIMED_OUT``.
"""

import argparse
import json
import os
import random
import re
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, NamedTuple

import httpx

from benchmarks.determinism_requests import HURRIED, PATIENT, REFUSED, Request
from benchmarks.machines import ENDED, local_server

_CLIENTS = 4
#: Answers between two lines of progress.
_TOLD_EVERY = 100
#: Longer than any request may take [s].
_LONGEST = 310.0
#: Times, which no two answers share, and names of jobs.
_TIMES = {"milliseconds", "computed_milliseconds"}
_OF_A_JOB = {"id", "created", "started", "ended", "expires"}
_TIME = re.compile(r"\d+(\.\d+)? m?s\b")
_SETTINGS = {"ARMWRIGHT_WORKERS": "2", "ARMWRIGHT_LOG_LEVEL": "error"}


class Told(NamedTuple):
    """One answer.

    Attributes:
        text: All of it but its times, in one order.
        code: SUCCESS, or that of the problem.
        flagged: whether it says that time ended a search.
    """

    text: str
    code: str
    flagged: bool


def without_times(value: Any) -> Any:
    """An answer, or a part of it, without its times."""
    if isinstance(value, dict):
        left_out = _TIMES | (_OF_A_JOB if "expires" in value else set())
        return {name: without_times(part) for name, part in value.items() if name not in left_out}
    if isinstance(value, list):
        return [without_times(part) for part in value]
    return _TIME.sub("some time", value) if isinstance(value, str) else value


def _flags(value: Any) -> Iterator[bool]:
    """All that parts of an answer say of themselves: false where time ended a search."""
    parts: Sequence[Any] = value if isinstance(value, list) else []
    if isinstance(value, dict):
        if "deterministic" in value:
            yield bool(value["deterministic"])
        parts = list(value.values())
    for part in parts:
        yield from _flags(part)


def read_answer(content: Any) -> Told:
    """What an answer or a problem tells, be it of a job or not."""
    problem = content.get("error") or content
    code = problem.get("code") or "SUCCESS"
    flagged = code == "TIMED_OUT" or not all(_flags(content))
    return Told(json.dumps(without_times(content), sort_keys=True), code, flagged)


def ask(client: httpx.Client, request: Request) -> Told:
    """Ask once, and wait for the job where it is one."""
    path, body = request
    answer = client.post(path, json=body)
    while answer.status_code == 429:
        time.sleep(float(answer.headers["retry-after"]))
        answer = client.post(path, json=body)
    if answer.status_code != 202:
        return read_answer(answer.json())
    job = answer.headers["location"]
    while (content := client.get(job).json())["status"] not in ENDED:
        time.sleep(0.05)
    return read_answer(content)


def faults(answers: Sequence[Told]) -> str | None:
    """The fault of answers to one request; None where they are one, or each other one says so.

    Answers that say nothing must be one. Those that time ended may be any.
    """
    certain = {answer.text for answer in answers if not answer.flagged}
    return None if len(certain) <= 1 else f"{len(certain)} answers that do not say so"


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Processes that do nothing but take processors."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def repeated(
    url: str, kinds: Mapping[str, Request], repeats: int, seed: int
) -> Mapping[str, list[Told]]:
    """The answers to each kind, asked for in random order by some clients.

    Args:
        url: Of the server.
        kinds: Requests by name.
        repeats: How often each is asked for.
        seed: Of the order.
    """
    order = [name for name in kinds for _ in range(repeats)]
    random.Random(seed).shuffle(order)
    found: dict[str, list[Told]] = defaultdict(list)
    with (
        httpx.Client(base_url=url, timeout=_LONGEST) as client,
        ThreadPoolExecutor(_CLIENTS) as pool,
    ):
        answers = pool.map(lambda name: ask(client, kinds[name]), order)
        for count, (name, answer) in enumerate(zip(order, answers, strict=True), 1):
            found[name].append(answer)
            if count % _TOLD_EVERY == 0:
                print(f"{count} of {len(order)} answers", file=sys.stderr, flush=True)
    return found


def report(found: Mapping[str, Sequence[Told]]) -> bool:
    """Print a row for each kind; whether all is well."""
    print("| request | answers | different | of them say so | codes | |\n|---|---|---|---|---|---|")
    well = True
    for name, answers in found.items():
        fault = faults(answers)
        well &= fault is None
        flagged = {answer.text for answer in answers if answer.flagged}
        codes = ", ".join(sorted({answer.code for answer in answers}))
        different = len({answer.text for answer in answers})
        print(
            f"| {name} | {len(answers)} | {different} | {len(flagged)} | {codes} | {fault or ''} |"
        )
    return well


def differences(answers: Sequence[Told]) -> Iterator[str]:
    """Where the first two different answers that say nothing differ, as a path of names."""
    texts = sorted({answer.text for answer in answers if not answer.flagged})
    if len(texts) > 1:
        yield from _different(json.loads(texts[0]), json.loads(texts[1]), "")


def _different(a: Any, b: Any, where: str) -> Iterator[str]:
    if isinstance(a, dict) and isinstance(b, dict):
        for name in sorted(a.keys() | b.keys()):
            yield from _different(a.get(name), b.get(name), f"{where}.{name}")
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for number, (one, other) in enumerate(zip(a, b, strict=True)):
            yield from _different(one, other, f"{where}[{number}]")
    elif a != b:
        yield f"{where}: {str(a)[:80]} or {str(b)[:80]}"


def main() -> None:
    """Ask, compare, print; ends with 1 if answers differ and do not say so."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=20, help="of each request, over all servers")
    parser.add_argument("--busy", type=int, default=8, help="busy processes beside the server")
    parser.add_argument("--servers", type=int, default=2, help="started one after the other")
    parser.add_argument("--kinds", nargs="*", help="requests; all if left out")
    parser.add_argument("--url", help="of a server that runs already, in place of its own")
    chosen = parser.parse_args()
    requests = {**PATIENT, **REFUSED, **HURRIED}
    kinds = {name: requests[name] for name in chosen.kinds or requests}
    found: dict[str, list[Told]] = {name: [] for name in kinds}
    each = -(-chosen.repeats // chosen.servers)
    with busy(chosen.busy):
        for number in range(chosen.servers):
            if chosen.url is not None:
                told_of = repeated(chosen.url, kinds, each, number)
            else:
                settings = _SETTINGS | {"PYTHONHASHSEED": str(number + os.getpid() % 1000)}
                with local_server(settings) as (_, url):
                    told_of = repeated(url, kinds, each, number)
            for name, more in told_of.items():
                found[name] += more
    well = report(found)
    for name, answers in found.items():
        for line in list(differences(answers))[:8]:
            print(f"{name}{line}")
    sys.exit(not well)


if __name__ == "__main__":
    main()
