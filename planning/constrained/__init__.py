"""Planning and inverse kinematics under constraints."""
