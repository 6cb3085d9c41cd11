"""The artificial potential: control points, their forces, and the descent along them."""
