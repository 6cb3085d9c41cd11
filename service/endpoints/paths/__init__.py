"""Paths of fewer waypoints."""
