"""Reach of an arm: which poses it can take in a scene, and where its base should stand."""
