"""Runs: generating, sampling, resuming and importing families; their lineage, diversity and certificates."""
