"""Checks of rules and units, and their translation to plans."""
