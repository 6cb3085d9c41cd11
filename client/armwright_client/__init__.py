"""Typed client of the Armwright motion planning service."""

__version__ = "0.1.0"
