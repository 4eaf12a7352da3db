"""Families: reading and writing them, their pictures, and the environments of their members."""
