"""Caches of prepared values, bounded by the memory that they take."""
