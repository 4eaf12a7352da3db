"""Programs of a behaviour with the data of the members of a family."""
