"""Load files with all their imports, and check them together."""
