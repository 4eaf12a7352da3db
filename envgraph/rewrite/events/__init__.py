"""Event rules, the agenda, and listeners for matches."""
