"""Inverse kinematics: analytic branches, numeric descent, and gradient flow."""
