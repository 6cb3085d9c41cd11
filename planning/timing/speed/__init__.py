"""Timing within velocity and acceleration limits."""
