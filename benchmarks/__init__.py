"""Measurements of speed and success that docs/benchmarks.md shows, each by one command."""
