"""The network of view operators: built from patterns, subscribed to the store, and scheduled."""
