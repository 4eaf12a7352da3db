"""Emit code that finds matches and computes expressions on arrays."""
