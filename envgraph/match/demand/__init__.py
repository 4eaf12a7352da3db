"""The compiled matcher, which searches for matches on demand: compiled plans, closures and recursion."""
