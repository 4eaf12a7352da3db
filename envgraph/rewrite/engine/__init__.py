"""`Engine`: a model with its definitions, and all operations on both."""
