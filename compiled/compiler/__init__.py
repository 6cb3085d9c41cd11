"""Compiler of kernels: code that is named by its content, compiled in parts, stored and linked."""
