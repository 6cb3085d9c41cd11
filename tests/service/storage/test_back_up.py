"""The page about back-ups: its commands copy, restore and take an upgrade back."""

import os
import re
import subprocess
from pathlib import Path

import pytest
from sqlalchemy import text

from service.storage.database import Database, StoreError
from service.storage.store import Store, open_store
from service.storage.stores.key_store import ApiKey

PAGE = (Path(__file__).parents[3] / "docs/how_to/back_up.md").read_text("utf-8")
BLOCKS = re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)
COPY = {"sqlite": BLOCKS[0], "postgresql": BLOCKS[2]}
RESTORE = {"sqlite": BLOCKS[1], "postgresql": BLOCKS[3]}


def run(block: str, url: str, folder: Path) -> str:
    """Run commands of the page, as a person does."""
    data = url.removeprefix("sqlite:///").removesuffix("/armwright.db")
    more = {"ARMWRIGHT_DATA_DIR": data, "DATABASE": url.replace("+psycopg", "")}
    done = subprocess.run(
        ["sh", "-e", "-c", block],
        env={**os.environ, **more}, cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def held(store: Store) -> tuple[list[str], list[str]]:
    """Names of the scenes and of the keys."""
    scenes = [item.name for item in store.documents.list("scene", "", 100)]
    return scenes, [key.name for key in store.keys.list()]


@pytest.fixture
def kind(url: str) -> str:
    return url.partition(":")[0].partition("+")[0]


def test_a_copy_of_a_running_service_is_restored(url: str, kind: str, tmp_path: Path) -> None:
    store = open_store(url)
    store.documents.create("scene", "before", b"{}")
    store.keys.add(ApiKey("a" * 12, "first", "0" * 64))
    said = run(COPY[kind], url, tmp_path)
    assert kind == "postgresql" or said == "ok\n"
    store.documents.create("scene", "after", b"{}")
    store.documents.delete("scene", "before")
    assert held(store) == (["after"], ["first"])
    store.close()
    run(RESTORE[kind], url, tmp_path)
    restored = open_store(url)
    assert held(restored) == (["before"], ["first"])
    assert restored.documents.get("scene", "before").content == b"{}"
    restored.documents.create("scene", "again", b"{}")
    restored.close()


def test_an_upgrade_is_taken_back(url: str, kind: str, tmp_path: Path) -> None:
    store = open_store(url)
    store.documents.create("scene", "before", b"{}")
    store.close()
    run(COPY[kind], url, tmp_path)
    newer = Database(url)
    with newer.transaction() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
        connection.execute(text("CREATE TABLE of_a_newer_version (id INTEGER)"))
    newer.close()
    with pytest.raises(StoreError, match="newer"):
        open_store(url)
    run(RESTORE[kind], url, tmp_path)
    restored = open_store(url)
    assert held(restored) == (["before"], [])
    restored.close()
