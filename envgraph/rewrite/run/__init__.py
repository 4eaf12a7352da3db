"""Rules and units as functions that change a model."""
