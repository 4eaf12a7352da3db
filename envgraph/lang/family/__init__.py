"""Read family files (`family.toml`)."""
