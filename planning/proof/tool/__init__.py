"""Proof that the tool keeps to its path at every instant."""
