"""Distances, overlaps and motion of meshes, by their triangles."""
