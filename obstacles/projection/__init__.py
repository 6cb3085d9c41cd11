"""Orthogonal projection of points onto obstacles."""
