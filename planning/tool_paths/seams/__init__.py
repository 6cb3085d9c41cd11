"""Planning along seams: tool paths with tolerances and a speed."""
