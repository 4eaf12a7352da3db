"""Learners that run in a program."""
