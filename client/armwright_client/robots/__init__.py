"""Robots as they are sent: descriptions, and URDF with its meshes."""
