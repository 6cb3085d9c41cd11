"""Storage of robots, scenes and prepared values."""
