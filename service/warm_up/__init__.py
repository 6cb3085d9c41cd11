"""Kernels and first requests: what workers compute before they serve."""
