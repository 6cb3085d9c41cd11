"""The artificial potential of a robot on its way to a goal."""
