"""Values that planners and proof share: limits, deadlines, costs."""
