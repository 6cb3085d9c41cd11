"""Straight and circular tool motions."""
