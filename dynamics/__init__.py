"""Equations of motion of a chain: M(q) q_ddot + C(q, q_dot) q_dot + B q_dot + G(q) = tau."""
