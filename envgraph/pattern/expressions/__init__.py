"""Expressions: their types and mistakes, their values, code for them, and why one has no value."""
