"""The data of a model: columns and links, their elementary changes, the journal, the state hash."""
