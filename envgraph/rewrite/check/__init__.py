"""Rules and units, checked and worked out to plans."""
