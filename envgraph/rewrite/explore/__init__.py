"""The states that rules can reach."""
