"""Kinds of constraints as values."""
