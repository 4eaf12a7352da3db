"""Code generation: from search plans to Python functions."""
