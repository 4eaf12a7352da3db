"""Emit code that changes a state as the operations of a rule do."""
