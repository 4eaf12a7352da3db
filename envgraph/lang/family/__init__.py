"""Family files: `family.toml` to data."""
