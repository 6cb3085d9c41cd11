"""Timing of given paths, and motions in other shapes."""
