"""Kept plans: requests with their answers or problems, and the robots and scenes in them."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from sqlalchemy import (
    Connection,
    delete,
    exists,
    func,
    insert,
    literal,
    or_,
    select,
    update,
)
from sqlalchemy.exc import IntegrityError

from service.storage.caches.cache_key import Kind
from service.storage.database import Database
from service.storage.tables import DEFAULT_TENANT, documents, plan_documents, plans, superfluous
from service.validation import ProblemError, storage_problem


@dataclass(frozen=True, slots=True)
class PlanRecord:
    """A kept request, without its content.

    Args:
        id: Id by which it is asked for; later ones sort after earlier ones.
        method: Method of HTTP.
        path: Path of the request.
        status: Status of HTTP: 200, or that of the problem.
        code: Code of the problem; None where there is an answer.
        robot: Name of the robot, if the request is about one.
        robot_hash: SHA-256 of its document; None for a built-in robot.
        scene: The name of the stored scene, if the request names one.
        scene_hash: SHA-256 of its document.
        seed: Seed of the request, if it has one.
        version: Version of the app that answered.
        digest: SHA-256 of the answer without measured times.
        created: Seconds since the epoch.
        job: The job that it answered, if it was one.
        replay_of: The kept plan that it replays, if it does.
        tenant: Tenant who owns the plan.
        api_key: Id of the key of its caller, if there was one.
        proved_here: Whether this service came to the answer, and what it says is proved.
    """

    id: str
    method: str
    path: str
    status: int
    code: str | None
    robot: str | None
    robot_hash: str | None
    scene: str | None
    scene_hash: str | None
    seed: int | None
    version: str
    digest: str
    created: float
    job: str | None = None
    replay_of: str | None = None
    tenant: str = DEFAULT_TENANT
    api_key: str | None = None
    proved_here: bool = False


@dataclass(frozen=True, slots=True)
class PlanContent:
    """Content of a kept plan: the body of the request, and the answer or problem, both JSON."""

    request: bytes
    answer: bytes


@dataclass(frozen=True, slots=True)
class Retention:
    """Bounds of what is kept of each tenant.

    Args:
        lifetime: How long [s].
        count: How many plans.
        storage: Requests and answers together, and robots and scenes together [byte].
    """

    lifetime: float
    count: int
    storage: int


_RECORD = tuple(plans.c[field.name] for field in dataclasses.fields(PlanRecord))
_SIZE = func.length(plans.c.request) + func.length(plans.c.answer)
_DOCUMENT_SIZE = func.sum(func.length(plan_documents.c.content))
_REFERENCES = or_(
    plans.c.robot_hash == plan_documents.c.hash, plans.c.scene_hash == plan_documents.c.hash
)
_ORPHANS = delete(plan_documents).where(
    ~exists().where(plans.c.tenant == plan_documents.c.tenant, _REFERENCES)
)


class PlanStore:
    """Kept plans in a database; every method blocks and is safe in any thread.

    Args:
        database: Database of the table.
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(
        self,
        record: PlanRecord,
        content: PlanContent,
        given: Mapping[str, bytes] = MappingProxyType({}),
    ) -> None:
        """Keep a plan, with the documents of its robot and scene as they are stored now.

        Args:
            record: The plan.
            content: Content of the plan.
            given: Documents of a plan of another installation, by their hashes.
        """
        try:
            self._insert(record, content, given)
        except IntegrityError:  # another server kept the same document between two statements
            self._insert(record, content, given)

    def note_proof(self, plan_id: str, tenant: str, answer: bytes) -> None:
        """Note that a plan was proved here, with the answer that this service came to."""
        its = (plans.c.id == plan_id) & (plans.c.tenant == tenant)
        with self._database.transaction(durable=False) as connection:
            connection.execute(update(plans).where(its).values(proved_here=True, answer=answer))

    def get(self, plan_id: str, tenant: str) -> tuple[PlanRecord, PlanContent]:
        """A kept plan of a tenant.

        Raises:
            ProblemError: NOT_FOUND.
        """
        found = select(*_RECORD, plans.c.request, plans.c.answer).where(
            plans.c.id == plan_id.partition("\0")[0], plans.c.tenant == tenant
        )
        row = self._database.row(found)
        if row is None:
            raise no_plan(plan_id)
        *values, request, answer = row
        return PlanRecord(*values), PlanContent(bytes(request), bytes(answer))

    def document(self, digest: str, tenant: str) -> bytes | None:
        """The document of a hash that a kept plan of a tenant refers to, if it is there."""
        found = select(plan_documents.c.content).where(
            plan_documents.c.hash == digest, plan_documents.c.tenant == tenant
        )
        with self._database.reading() as connection:
            content = connection.execute(found).scalar_one_or_none()
        return None if content is None else bytes(content)

    def list(
        self, before: str, limit: int, tenant: str, *, robot: str | None = None
    ) -> list[PlanRecord]:
        """The last `limit` plans of a tenant whose ids sort before `before`, newest first.

        Args:
            before: An id, or nothing.
            limit: How many at most.
            tenant: Tenant who owns them.
            robot: Only those of a robot of this name.
        """
        chosen = select(*_RECORD).where(plans.c.tenant == tenant)
        chosen = chosen.order_by(plans.c.id.desc()).limit(limit)
        if before:
            chosen = chosen.where(plans.c.id < before.partition("\0")[0])
        if robot is not None:
            chosen = chosen.where(plans.c.robot == robot.partition("\0")[0])
        return [PlanRecord(*row) for row in self._database.rows(chosen)]

    def delete(self, plan_id: str, tenant: str) -> None:
        """Forget a plan, and documents that no other one refers to.

        Raises:
            ProblemError: NOT_FOUND.
        """
        its = (plans.c.id == plan_id.partition("\0")[0]) & (plans.c.tenant == tenant)
        with self._database.transaction() as connection:
            gone = connection.execute(delete(plans).where(its)).rowcount
            connection.execute(_ORPHANS)
        if gone == 0:
            raise no_plan(plan_id)

    def purge(self, now: float, retention: Retention) -> None:
        """Forget plans that are too old, and the oldest of too many or too large ones of a tenant.

        Args:
            now: Seconds since the epoch.
            retention: Bounds of the plans that each tenant may keep.
        """
        too_many = superfluous(plans, plans.c.created, _SIZE, retention.count, retention.storage)
        with self._database.transaction(durable=False) as connection:
            gone = connection.execute(
                delete(plans).where(plans.c.created < now - retention.lifetime)
            ).rowcount
            gone += connection.execute(delete(plans).where(plans.c.id.in_(too_many))).rowcount
            if gone:
                connection.execute(_ORPHANS)
            for tenant in _tenants_above(connection, retention.storage):
                while _document_bytes(connection, tenant) > retention.storage:
                    if not _forget_oldest_with_document(connection, tenant):
                        break

    def _insert(self, record: PlanRecord, content: PlanContent, given: Mapping[str, bytes]) -> None:
        values = dataclasses.asdict(record)
        values |= {"request": content.request, "answer": content.answer}
        with self._database.transaction(durable=record.job is not None) as connection:
            connection.execute(insert(plans), values)
            for digest, document in given.items():
                _keep_given(connection, record.tenant, digest, document)
            if record.robot is not None and record.robot_hash is not None:
                _keep_stored(connection, record.tenant, "robot", record.robot, record.robot_hash)
            if record.scene is not None and record.scene_hash is not None:
                _keep_stored(connection, record.tenant, "scene", record.scene, record.scene_hash)


def _keep_stored(connection: Connection, tenant: str, kind: Kind, name: str, digest: str) -> None:
    """Copy the document of a robot or scene, unless it is kept or was replaced meanwhile."""
    kept = exists().where(plan_documents.c.tenant == tenant, plan_documents.c.hash == digest)
    stored = select(literal(tenant), literal(digest), documents.c.content).where(
        documents.c.tenant == tenant,
        documents.c.kind == kind,
        documents.c.name == name,
        documents.c.hash == digest,
        ~kept,
    )
    columns = ("tenant", "hash", "content")
    connection.execute(insert(plan_documents).from_select(columns, stored))


def _keep_given(connection: Connection, tenant: str, digest: str, content: bytes) -> None:
    kept = select(plan_documents.c.hash).where(
        plan_documents.c.tenant == tenant, plan_documents.c.hash == digest
    )
    if connection.execute(kept).one_or_none() is None:
        values = {"tenant": tenant, "hash": digest, "content": content}
        connection.execute(insert(plan_documents), values)


def _tenants_above(connection: Connection, size: int) -> Sequence[str]:
    """Tenants whose kept documents are larger than a size together [byte]."""
    owner = plan_documents.c.tenant
    above = select(owner).group_by(owner).having(size < _DOCUMENT_SIZE)
    return connection.execute(above).scalars().all()


def _document_bytes(connection: Connection, tenant: str) -> int:
    total = select(func.coalesce(_DOCUMENT_SIZE, 0)).where(plan_documents.c.tenant == tenant)
    return int(connection.execute(total).scalar_one())


def _forget_oldest_with_document(connection: Connection, tenant: str) -> bool:
    """Forget the oldest plan of a tenant with a document but the newest; whether there was one."""
    referring: Sequence[str] = (
        connection.execute(
            select(plans.c.id)
            .where(plans.c.tenant == tenant)
            .where(or_(plans.c.robot_hash.is_not(None), plans.c.scene_hash.is_not(None)))
            .order_by(plans.c.created, plans.c.id)
            .limit(2)
        )
        .scalars()
        .all()
    )
    if len(referring) <= 1:
        return False
    connection.execute(delete(plans).where(plans.c.id == referring[0]))
    connection.execute(_ORPHANS)
    return True


def no_plan(plan_id: str) -> ProblemError:
    """The problem of a kept plan that is not there."""
    return storage_problem(
        "NOT_FOUND",
        f"there is no kept plan {plan_id[:100]!r}",
        hint='GET /v1/plans lists those there are; a request with "keep": true adds one, and old '
        "ones are forgotten.",
    )
