"""Exploration of all states that rules and units can reach."""
