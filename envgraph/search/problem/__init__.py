"""Search problems: constraints, measures of models, measures of families, and objectives."""
