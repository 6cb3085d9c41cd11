"""Other libraries on the same problems, each in an interpreter of its own."""
