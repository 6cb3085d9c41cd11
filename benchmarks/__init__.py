"""Measurements: what is claimed about speed and success, repeatable."""
