"""Inverse kinematics of a robot."""
