"""Proof that nothing touches at any instant."""
