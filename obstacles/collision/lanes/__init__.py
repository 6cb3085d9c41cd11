"""Collision checks of eight configurations at a time, one in each SIMD lane."""
