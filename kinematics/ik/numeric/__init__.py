"""Inverse kinematics of any chain by damped least squares."""
