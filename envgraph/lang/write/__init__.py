"""Write models, patterns, rules and units as text."""
