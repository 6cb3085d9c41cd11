"""The built-in robot models, from published parameters."""
