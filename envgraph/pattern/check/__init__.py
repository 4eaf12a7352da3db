"""Check patterns and report all their errors and warnings."""
