"""Timing by splines."""
