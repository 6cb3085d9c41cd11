"""The studio's page: widgets and drawings in a browser, served by viser."""
