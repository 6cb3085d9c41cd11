"""Endpoints, one folder a noun: `route` runs in the server, all other modules in workers."""

from armwright_wire.base import build_at_once

build_at_once()
