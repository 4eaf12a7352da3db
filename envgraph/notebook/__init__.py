"""Show and play environments in notebooks."""
