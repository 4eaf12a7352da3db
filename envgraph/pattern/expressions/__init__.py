"""Expressions: type checks, evaluation, code generation, and the causes of missing values."""
