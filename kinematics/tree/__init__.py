"""Robots as trees of links and joints, and the chain that is cut out of a tree."""
