"""Endpoints, one folder a noun: `route` runs in the server, all other modules in workers."""
