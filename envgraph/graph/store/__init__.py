"""The data of a model in columns and relations, the elementary changes, the undo log, and the state hash."""
