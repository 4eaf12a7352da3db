"""Plans as text, what they do when they run, and why a pattern has no match."""
