"""Bounds of the deviation of the tool from its motion."""
