"""Timing with bounded jerk."""
