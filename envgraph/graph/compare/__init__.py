"""Compare models up to isomorphism: a canonical hash and an exact test."""
