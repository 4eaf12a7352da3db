"""Models compared up to isomorphism."""
