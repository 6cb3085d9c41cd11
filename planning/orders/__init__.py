"""Orders and alternatives of stages that are left open."""
