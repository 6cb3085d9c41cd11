"""Recorded motions and logs of arms, read from the files that people have."""
