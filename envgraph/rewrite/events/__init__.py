"""Event rules, the agenda, and listeners of matches."""
