"""Errors of registrations with markers found by searches; all is simulated."""
