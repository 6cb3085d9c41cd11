"""Tours over many goals."""
