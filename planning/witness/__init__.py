"""Witness of a certificate: facts that anybody can check, with bounds of their own."""
