"""Planning of motions, and proofs of given motions."""
