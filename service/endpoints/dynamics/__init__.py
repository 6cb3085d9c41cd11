"""Equations of motion, regressors and statics of a robot."""
