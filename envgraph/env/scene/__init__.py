"""Scenes: pictures of models as their `draw` clause defines them, and their rendering as text, pixels and SVG."""
