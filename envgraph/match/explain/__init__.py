"""Explanations: plans as text, measured row counts, and reasons why a pattern has no match."""
