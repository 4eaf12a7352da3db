"""Checked writes of a model: objects, names, values and links, and the messages of refused writes."""
