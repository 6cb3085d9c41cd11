"""Distances and overlaps of two convex pieces."""
