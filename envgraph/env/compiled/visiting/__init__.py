"""Visits of all reachable states by a program: tables, plans, explorations."""
