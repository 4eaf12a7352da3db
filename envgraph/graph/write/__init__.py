"""Checked writes of a model: objects, names, values and links, and the errors of refused writes."""
