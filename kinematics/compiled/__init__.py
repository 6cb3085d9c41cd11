"""The compiler's adapters: kernels, SIMD vectors and SIMD frames."""
