"""The matcher that looks for matches when it is asked: compiled plans, closures, recursion."""
