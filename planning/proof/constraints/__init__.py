"""Proof that path constraints hold at every instant."""
