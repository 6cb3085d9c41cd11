"""Logs: as text or as JSON, with the ids of request, job and key, and never as a flood."""

import json
import logging
import os
import re
import time
from contextvars import ContextVar
from typing import Literal

LogFormat = Literal["text", "json"]

#: Id of the request that is being answered.
request_id: ContextVar[str | None] = ContextVar("request_id", default=None)
#: Id of the job that it belongs to.
job_id: ContextVar[str | None] = ContextVar("job_id", default=None)
#: Id of the key that its caller has shown.
key_id: ContextVar[str | None] = ContextVar("key_id", default=None)
#: Id of the trace that it is part of, where there are traces.
trace_id: ContextVar[str | None] = ContextVar("trace_id", default=None)

_IDS = {"request": request_id, "job": job_id, "key": key_id, "trace": trace_id}
#: Ids of callers that are taken over: what would be dangerous in a log is not in them.
_SAFE_ID = re.compile(r"[A-Za-z0-9_.\-]{1,64}")
#: Records of one kind that are written in a period, and the period [s]: a fault that happens with
#: every connection would fill the disk.
_MAX_RECORDS = 20
_PERIOD = 10.0


def new_request_id(proposed: str | None) -> str:
    """The id of a request: that which its caller proposes, if it is harmless, or a new one."""
    if proposed is not None and _SAFE_ID.fullmatch(proposed):
        return proposed
    return os.urandom(8).hex()


class JsonFormatter(logging.Formatter):
    """One JSON object a line: time, level, logger, message, the ids that are known, a traceback."""

    def format(self, record: logging.LogRecord) -> str:
        """The line of a record."""
        fields: dict[str, object] = {
            "time": time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created))
            + f".{int(record.msecs):03d}Z",
            "level": record.levelname.lower(),
            "logger": record.name.removeprefix("armwright._src."),
            "message": record.getMessage(),
        }
        for name, variable in _IDS.items():
            value = variable.get()
            if value is not None:
                fields[name] = value
        fields |= getattr(record, "fields", {})
        if record.exc_info:
            fields["traceback"] = self.formatException(record.exc_info)
        return json.dumps(fields, ensure_ascii=False, default=str)


class FloodGate(logging.Filter):
    """Lets a bounded number of records of each kind pass; the next one tells how many did not.

    Args:
        limit: Records of a kind in a period.
        period: Length of the period [s].
    """

    def __init__(self, limit: int = _MAX_RECORDS, period: float = _PERIOD) -> None:
        super().__init__()
        self._limit = limit
        self._period = period
        self._kinds: dict[tuple[str, str], list[float]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a record passes."""
        kind = record.name, str(record.msg)
        if kind not in self._kinds and len(self._kinds) > 1000:
            self._kinds.clear()
        begun, count = self._kinds.get(kind, (record.created, 0.0))
        if record.created - begun >= self._period:
            suppressed = int(count) - self._limit
            if suppressed > 0:
                record.msg = f"{record.getMessage()} ({suppressed} more of these were not written)"
                record.args = None
            begun, count = record.created, 0.0
        self._kinds[kind] = [begun, count + 1]
        return count < self._limit or record.levelno >= logging.CRITICAL


def configure(log_format: LogFormat) -> None:
    """Have everything that this process logs written to its error stream.

    Args:
        log_format: Format: lines for people, or JSON for programs.
    """
    handler = logging.StreamHandler()
    handler.addFilter(FloodGate())
    if log_format == "json":
        handler.setFormatter(JsonFormatter())
    else:
        text = "%(asctime)s %(levelname)s %(name)s: %(message)s"
        handler.setFormatter(logging.Formatter(text))
    logging.basicConfig(handlers=[handler], force=True)
