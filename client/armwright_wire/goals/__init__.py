"""Goals of motions, motions of the tool, and constraints on poses."""
