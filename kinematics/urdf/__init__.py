"""URDF and SRDF files: read strictly, and written from a chain."""
