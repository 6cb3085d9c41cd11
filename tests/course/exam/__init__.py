"""An exam of the course notes: questions on other arms and numbers, answered independently."""
