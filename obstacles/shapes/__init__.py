"""Shapes of obstacles as values."""
