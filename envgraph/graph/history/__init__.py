"""Transactions, savepoints and versions, and repair after exceptions."""
