"""Convex pieces: hulls, covers by spheres, nearest points."""
