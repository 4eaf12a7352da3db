"""Files with all that they import, read and checked together."""
