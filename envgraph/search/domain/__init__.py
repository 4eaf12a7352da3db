"""The files of a domain, prepared for a search: named components, constraints and the initial model."""
