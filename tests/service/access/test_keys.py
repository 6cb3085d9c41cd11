"""API keys as callers show them: long, random, and of one form."""

import hashlib

import pytest

from service.access import secret


def test_a_key_has_256_random_bits_and_is_read_back() -> None:
    made = [secret.new_credentials() for _ in range(100)]
    assert len({credentials.secret for credentials in made}) == 100
    assert len({credentials.id for credentials in made}) == 100
    for credentials in made:
        assert len(bytes.fromhex(credentials.secret)) == 32
        assert secret.parse(str(credentials)) == credentials
        assert str(credentials) == f"aw_{credentials.id}_{credentials.secret}"


@pytest.mark.parametrize(
    "text",
    ["", "aw__", "aw_0123456789ab_", "aw_0123456789ab_" + "0" * 63, "aw_0123456789ab_" + "0" * 65,
     "AW_0123456789ab_" + "0" * 64, "aw_0123456789AB_" + "0" * 64, "aw_0123456789ab_" + "g" * 64,
     "aw_0123456789ab_" + "0" * 64 + "\n", " aw_0123456789ab_" + "0" * 64],
)  # fmt: skip
def test_another_form_is_no_key(text: str) -> None:
    assert secret.parse(text) is None


def test_only_the_digest_fits() -> None:
    made = secret.new_credentials()
    stored = secret.digest(made.secret)
    assert stored == hashlib.sha256(made.secret.encode("ascii")).hexdigest()
    assert secret.fits(made.secret, stored)
    assert not secret.fits(secret.new_credentials().secret, stored)
    assert made.secret not in stored
