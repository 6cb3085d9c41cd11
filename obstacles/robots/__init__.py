"""Solids of robots, objects they hold, and pairs of links that may touch."""
