"""Views as text, with measured numbers of partial matches."""
