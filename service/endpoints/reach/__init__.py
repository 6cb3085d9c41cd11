"""Reach of an arm, and placement of its base."""
