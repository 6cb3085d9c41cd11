"""Sequences of stages: pick and place as one question with one proved answer."""
