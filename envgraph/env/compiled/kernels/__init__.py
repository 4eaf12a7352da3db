"""Fixed modules that precede the text of every program, compiled by numba or run as Python; loading programs."""
