"""Inverse kinematics in closed form: every branch of arms that have one."""
