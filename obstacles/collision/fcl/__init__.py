"""Exact distances and overlaps of a robot in a scene, by FCL."""
