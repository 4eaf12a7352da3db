"""Packages with a program that step without envgraph."""
