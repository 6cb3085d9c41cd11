"""Kernels compiled with numba, vectors of eight SIMD lanes, and arithmetic for kernels."""
