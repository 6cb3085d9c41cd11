"""Controllers, their gains and their Lyapunov functions."""
