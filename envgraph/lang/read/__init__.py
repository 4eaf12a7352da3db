"""Trees to data: one module a language."""
