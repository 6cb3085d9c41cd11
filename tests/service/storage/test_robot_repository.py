"""Robots and scenes by name."""

import pytest

from service.problem import ProblemError
from service.storage.caches.cache_key import Kind, Reference, builtin_reference
from service.storage.caches.prepared_files import document_hash
from service.storage.robot_repository import RobotRepository, is_built_in
from service.storage.store import Store


def found(repository: RobotRepository, kind: Kind, name: str) -> Reference:
    (reference,) = repository.look_up([(kind, name)])
    assert reference is not None
    return reference


def test_built_in_robots_need_no_store_and_go_first(store: Store) -> None:
    store.documents.create("robot", "panda", b"another one")
    repository = RobotRepository(store.documents, "folder")
    assert found(repository, "robot", "panda") == builtin_reference("panda", "folder")
    assert is_built_in("panda")
    assert not is_built_in("Panda")


def test_a_stored_robot_is_known_by_the_hash_of_its_document(store: Store) -> None:
    store.documents.create("robot", "mine", b"one")
    repository = RobotRepository(store.documents, "folder")
    before = found(repository, "robot", "mine")
    assert (before.kind, before.hash) == ("robot", document_hash(b"one"))
    assert (before.folder, before.built_in) == ("folder", False)
    assert repository.document(before) == (before, b"one")
    store.documents.replace("robot", "mine", b"two")
    after, content = repository.document(before)
    assert content == b"two"
    assert after == found(repository, "robot", "mine") != before


def test_scenes_and_robots_have_names_of_their_own(store: Store) -> None:
    store.documents.create("scene", "table", b"{}")
    repository = RobotRepository(store.documents, "folder")
    assert found(repository, "scene", "table").kind == "scene"
    with pytest.raises(ProblemError) as missing:
        found(repository, "robot", "table")
    assert missing.value.code == "NOT_FOUND"
    assert "panda" in (missing.value.hint or ""), "the hint lists the built-in ones"
    with pytest.raises(ProblemError):
        found(repository, "scene", "panda")
