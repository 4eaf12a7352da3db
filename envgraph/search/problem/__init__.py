"""Search problems: constraints, measures of models and of families, and objectives."""
