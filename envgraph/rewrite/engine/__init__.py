"""`Engine`: a model with its definitions, and all that can be asked of it and done with it."""
