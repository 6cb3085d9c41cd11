"""Pages for people: start page, documentation, kinds of problems."""
