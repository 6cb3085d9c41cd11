"""The robot model and its geometry: chains, poses, forward and inverse kinematics, Jacobians."""
