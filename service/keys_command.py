"""The commands ``armwright keys`` and ``armwright audit``."""

import argparse
import dataclasses
import os
import sys
import time
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

from pydantic import ValidationError

from service.access.authentication import digest, new_credentials, parse
from service.settings import Settings
from service.storage.database import StorageUnavailable, StoreError
from service.storage.store import Store, open_store
from service.storage.stores.audit_store import last_entries
from service.storage.stores.key_store import ApiKey

#: File in the data folder with the first key, where a random one was made.
FIRST_KEY = "first_key"
#: Seconds of a day.
_DAY = 86400.0


def run(options: argparse.Namespace) -> int:
    """Run a command and give the exit code."""
    given = {} if options.data_dir is None else {"data_dir": options.data_dir}
    try:
        store = open_store(Settings(**given).storage_url)
        try:
            return _run(options, store)
        finally:
            store.close()
    except (StoreError, StorageUnavailable, ValidationError) as error:
        return _refuse(str(error))


def make_first_key(store: Store, settings: Settings, *, is_needed: bool) -> str | None:
    """Make the first API key of a service that has none; a sentence about it, if one was made.

    It is the one of the settings, or a random one in a file that only this user may read.

    Args:
        store: Store of the keys.
        settings: Settings of the service.
        is_needed: Whether others reach the service, who must not without a key.

    Raises:
        StoreError: The file can't be written.
    """
    if store.keys.are_there_any() or not (is_needed or settings.first_key):
        return None
    credentials = parse(settings.first_key) if settings.first_key else new_credentials()
    assert credentials is not None
    told = f"There was no API key: the one of ARMWRIGHT_FIRST_KEY, {credentials.id}, was made."
    if settings.first_key is None:
        file = settings.data_dir / FIRST_KEY
        _write_secret(file, f"{credentials}\n")
        told = f"There was no API key: a first one, of the scope admin, is in {file}."
    secret_digest = digest(credentials.secret)
    key = ApiKey(credentials.id, "first", secret_digest, scope="admin", created=time.time())
    # Another server with the same settings may have made it between the statements.
    return told if store.keys.add(key) else None


def _write_secret(file: Path, text: str) -> None:
    """Write a new file that only this user may read."""
    try:
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        file.unlink(missing_ok=True)
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL
        with os.fdopen(os.open(file, flags, 0o600), "w") as handle:
            handle.write(text)
    except OSError as error:
        raise StoreError(f"the first API key can't be written to {file}: {error}") from error


def _run(options: argparse.Namespace, store: Store) -> int:
    if options.command == "audit":
        _show(
            (_time(entry.time), entry.tenant, entry.api_key, entry.action, entry.target)
            for entry in last_entries(store.database, options.limit)
        )
    elif options.keys == "create":
        print(_create(options, store))
    elif options.keys == "list":
        _show(_row(key) for key in store.keys.list())
    elif not store.keys.revoke(options.id):
        return _refuse(f"there is no key {options.id!r} that is not revoked")
    return 0


def _create(options: argparse.Namespace, store: Store) -> str:
    """The new key as a caller shows it; this is the only time that its secret is seen."""
    credentials = new_credentials()
    now = time.time()
    key = ApiKey(
        credentials.id,
        options.name,
        digest(credentials.secret),
        scope=options.scope,
        tenant=options.tenant,
        created=now,
        expires=None if options.days is None else now + options.days * _DAY,
        rate=options.rate,
        job_limit=options.jobs,
        storage_limit=options.storage,
    )
    store.keys.add(key)
    return str(credentials)


def _row(key: ApiKey) -> tuple[object, ...]:
    state = "revoked" if key.revoked else "valid" if key.is_valid(time.time()) else "expired"
    limits = [
        f"{name} {value}"
        for name in ("rate", "job_limit", "storage_limit")
        if (value := dataclasses.asdict(key)[name]) is not None
    ]
    expires = "never" if key.expires is None else _time(key.expires)
    return key.id, key.name, key.tenant, key.scope, state, expires, ", ".join(limits)


def _show(rows: Iterable[tuple[object, ...]]) -> None:
    for row in rows:
        print("\t".join("-" if cell is None else str(cell) for cell in row))


def _time(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="seconds")


def _refuse(reason: str) -> int:
    print(f"armwright: {reason}", file=sys.stderr)
    return 1
