"""Settings of the service, each also an environment variable ``ARMWRIGHT_<NAME>``."""

import os
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

from platformdirs import user_data_path
from pydantic import Field, StringConstraints, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

_MEBIBYTE = 1024 * 1024

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


class Settings(BaseSettings):
    """Settings of the service.

    Raises:
        pydantic.ValidationError: A value has the wrong type or lies outside its range.
    """

    model_config = SettingsConfigDict(
        env_prefix="ARMWRIGHT_", extra="ignore", frozen=True, use_attribute_docstrings=True
    )

    host: str = "127.0.0.1"
    """address to listen on"""
    port: int = Field(8000, ge=0, le=65535)
    """port to listen on, 0 for a free one"""
    data_dir: Path = Field(default_factory=lambda: user_data_path("armwright", appauthor=False))
    """folder of the database"""
    database_url: Annotated[str, StringConstraints(min_length=1)] | None = None
    """where all is kept: sqlite:///<path> or postgresql+psycopg://...;
    sqlite:///<data_dir>/armwright.db if left out
    """
    workers: int = Field(default_factory=lambda: os.cpu_count() or 1, ge=1, le=256)
    """worker processes"""
    queue_limit: int = Field(64, ge=0)
    """requests that may wait for a worker"""
    max_body_size: int = Field(64 * _MEBIBYTE, ge=1024)
    """largest request body [byte]"""
    body_timeout: Positive = 30.0
    """longest silence within a request body [s]"""
    body_deadline: Positive = 120.0
    """time in which a body must arrive [s]"""
    head_timeout: Positive = 10.0
    """time in which the head of a request must arrive [s]"""
    connection_limit: int = Field(1000, ge=1)
    """open connections; the system's limit of descriptors may be lower"""
    allowed_hosts: str = ""
    """names, parted by commas, under which the service is asked, beside addresses and names without
    a dot; .example.com for all below it, * for any
    """
    cors_origins: str = ""
    """origins, parted by commas, whose pages may ask; * for any"""
    default_timeout: Positive = 10.0
    """deadline of a request that names none [s]"""
    max_timeout: Positive = 300.0
    """longest deadline a request may name [s]"""
    kill_grace: Positive = 0.1
    """overrun of a deadline before the kill [s]"""
    audit: Literal["sampled", "off"] = "sampled"
    """whether kept proofs are looked at once more by other code, at most 5 % of the time they took
    """
    worker_memory: int = Field(2048 * _MEBIBYTE, ge=64 * _MEBIBYTE)
    """memory that a request may take beyond what its worker was forked with [byte]"""
    worker_growth: int = Field(512 * _MEBIBYTE, ge=16 * _MEBIBYTE)
    """memory that a worker may keep between requests; then it is replaced [byte]"""
    worker_jobs: int = Field(10_000, ge=1)
    """jobs after which a worker is replaced"""
    worker_age: Positive = 6 * 3600.0
    """age at which a worker is replaced [s]"""
    prepared_storage: int = Field(1024 * _MEBIBYTE, ge=_MEBIBYTE)
    """room for prepared robots and scenes [byte]"""
    jobs: Literal["server", "agents", "both"] = "server"
    """who works on the jobs that this server accepts: itself, agents, or agents and itself as one
    of them; agents need PostgreSQL
    """
    job_limit: int = Field(256, ge=0)
    """jobs that may be queued or running"""
    job_deadline: Positive = 3600.0
    """time within which an accepted job must end [s]"""
    job_lifetime: Positive = 24 * 3600.0
    """how long ended jobs are kept [s]"""
    job_count: int = Field(1000, ge=1)
    """how many ended jobs of a tenant are kept"""
    job_storage: int = Field(1024 * _MEBIBYTE, ge=_MEBIBYTE)
    """room for requests of jobs, and for answers of jobs of a tenant [byte]"""
    plan_lifetime: Positive = 7 * 24 * 3600.0
    """how long kept plans are kept [s]"""
    plan_count: int = Field(1000, ge=1)
    """how many plans of a tenant are kept"""
    plan_storage: int = Field(1024 * _MEBIBYTE, ge=_MEBIBYTE)
    """room for the kept plans of a tenant, and as much for their robots and scenes [byte]"""
    batch_limit: int = Field(1000, ge=1, le=100_000)
    """problems in one batch"""
    keep_alive: Positive = 15.0
    """longest silence of an event stream [s]"""
    first_key: (
        Annotated[str, StringConstraints(pattern=r"^aw_[0-9a-f]{12}_[0-9a-f]{64}$")] | None
    ) = Field(None, repr=False)
    """API key of the scope admin that is made at the start if there is none, aw_ with 12 and 64
    hexadecimal digits; where others reach the service, a random one is written to first_key in the
    data folder if left out
    """
    insecure: bool = False
    """listen beyond this machine though there are no API keys"""
    public_health: bool = True
    """whether health is told without an API key"""
    public_metrics: bool = False
    """whether metrics are told without an API key"""
    traces: Annotated[str, StringConstraints(pattern=r"^https?://[^/\s]+")] | None = None
    """collector of traces, OTLP over HTTP, such as http://localhost:4318; none are written if left
    out
    """
    log_format: Literal["text", "json"] = "text"
    """lines for people or JSON"""
    log_requests: bool = False
    """whether each request has a line in the log"""
    log_level: Literal["debug", "info", "warning", "error"] = "info"
    """least severity that is logged"""

    @model_validator(mode="after")
    def _check_timeouts(self) -> "Settings":
        if self.default_timeout > self.max_timeout:
            raise ValueError("default_timeout must not exceed max_timeout")
        return self

    @cached_property
    def host_names(self) -> frozenset[str]:
        """Names of this service beside those that are always allowed, in lower case."""
        return frozenset(name.lower() for name in _parts(self.allowed_hosts))

    @cached_property
    def origins(self) -> tuple[str, ...]:
        """Origins whose pages may ask."""
        return _parts(self.cors_origins)

    @cached_property
    def prepared_dir(self) -> str:
        """Folder of prepared robots and scenes."""
        return str(self.data_dir.absolute() / "prepared")

    @property
    def storage_url(self) -> str:
        """The database URL, in the data folder unless one was given."""
        return self.database_url or f"sqlite:///{self.data_dir.absolute() / 'armwright.db'}"


def _parts(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",") if part.strip())
