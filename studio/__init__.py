"""The studio: a page to set up, plan and watch motions, a client of the HTTP service."""
