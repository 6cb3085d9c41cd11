"""API keys as callers show them: ``aw_<id>_<secret>``."""

import hashlib
import hmac
import re
import secrets
from typing import NamedTuple

#: Random bytes of the public and of the secret part: the secret has 256 bits.
_ID_BYTES = 6
_SECRET_BYTES = 32
_FORM = re.compile(r"aw_([0-9a-f]{12})_([0-9a-f]{64})")


class Credentials(NamedTuple):
    """The two parts of an API key.

    Args:
        id: Id by which it is found; no secret.
        secret: Known to the caller alone.
    """

    id: str
    secret: str

    def __str__(self) -> str:
        return f"aw_{self.id}_{self.secret}"


def new_credentials() -> Credentials:
    """The parts of a new API key, from the random numbers of the system."""
    return Credentials(secrets.token_hex(_ID_BYTES), secrets.token_hex(_SECRET_BYTES))


def parse(text: str) -> Credentials | None:
    """The parts of an API key; None if it has not the form of one."""
    match = _FORM.fullmatch(text)
    return None if match is None else Credentials(match[1], match[2])


def digest(secret: str) -> str:
    """SHA-256 of a secret, in hexadecimal digits; with 256 random bits nobody can search it."""
    return hashlib.sha256(secret.encode()).hexdigest()


def fits(secret: str, stored_digest: str) -> bool:
    """Whether a secret has a digest, in a time that does not depend on where they differ."""
    return hmac.compare_digest(digest(secret), stored_digest)
