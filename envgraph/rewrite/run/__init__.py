"""Compilation of rules and units to functions that change a model."""
