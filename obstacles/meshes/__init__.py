"""Triangle meshes: read, checked, written, and decomposed into convex pieces."""
