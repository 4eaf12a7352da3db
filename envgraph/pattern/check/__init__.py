"""Everything that can be wrong with patterns."""
