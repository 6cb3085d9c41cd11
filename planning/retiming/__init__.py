"""Timing of given paths, and timed motions between two states."""
