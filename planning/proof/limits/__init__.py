"""Proof that a motion keeps its limits at every instant."""
