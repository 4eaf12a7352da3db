"""Runs: evolved, sampled, resumed and imported; lineage, diversity and certificates of their families."""
