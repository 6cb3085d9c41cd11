"""The pipeline from a problem to a certified trajectory."""
