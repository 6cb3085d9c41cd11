"""The page that shows a kept plan: triangles, curves and words in one HTML file."""
