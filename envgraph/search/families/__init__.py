"""Families: read, written, shown, and made into environments."""
