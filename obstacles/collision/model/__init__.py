"""A robot in a scene, packed for the kernels of collision checks."""
