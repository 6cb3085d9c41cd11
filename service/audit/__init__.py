"""Second look at certified motions, by code that shares nothing with what plans and proves."""
