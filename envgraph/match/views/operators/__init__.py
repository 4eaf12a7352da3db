"""The operators of a view network: relations that are updated from the changes of others."""
