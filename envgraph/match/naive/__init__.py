"""The matcher that reads constraints one after another; the tests hold the others against it."""
