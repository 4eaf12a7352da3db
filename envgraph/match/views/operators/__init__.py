"""Operators: each holds one relation, journalled, and updates it."""
