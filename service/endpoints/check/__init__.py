"""Collision checks of configurations, and projection of points onto obstacles."""
