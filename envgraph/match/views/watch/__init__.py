"""Watched patterns: kept current, asked about, and their subscribers notified."""
