"""Straight and circular tool motions as values."""
