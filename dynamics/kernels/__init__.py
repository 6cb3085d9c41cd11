"""Kernels of the dynamics: recursions and composite bodies."""
