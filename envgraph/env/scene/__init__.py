"""Pictures of models, as their `draw` clause says: what is shown, and its renderings."""
