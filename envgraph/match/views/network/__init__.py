"""The network of operators: built from patterns, subscribed to the store, scheduled."""
