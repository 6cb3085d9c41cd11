"""The equations of motion D(q) q̈ + C(q, q̇) q̇ + G(q) = τ and their regressor."""
