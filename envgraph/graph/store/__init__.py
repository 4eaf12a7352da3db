"""The stored data of a model (columns and links), its elementary changes, the undo log, and the state hash."""
