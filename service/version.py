"""The version of the service, which `pyproject.toml` reads from here."""

VERSION = "0.4.0"
