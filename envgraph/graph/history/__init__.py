"""Transactions, savepoints, versions, and the repair of interrupted writes after exceptions."""
