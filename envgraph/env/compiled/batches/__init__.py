"""Environments that a program steps together."""
