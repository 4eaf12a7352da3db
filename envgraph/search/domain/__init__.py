"""The files of a domain as a search needs them: its parts by name, constraints, the initial model."""
