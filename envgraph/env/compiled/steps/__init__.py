"""Emit the functions of a program: actions, units, rewards, ends, turns, observations."""
