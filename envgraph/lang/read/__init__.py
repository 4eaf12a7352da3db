"""Convert syntax trees to frozen dataclasses, with one module for each language."""
