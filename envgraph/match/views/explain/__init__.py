"""Explanations of views as text, with measured numbers of partial matches."""
