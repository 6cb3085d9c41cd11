"""Arms, scenes and poses that benchmarks use."""
