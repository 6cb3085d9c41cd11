"""Simulation of the closed loop of robot, controller and reference."""
