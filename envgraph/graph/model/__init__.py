"""The model as callers see it, handles of its objects, its conformance and its pictures."""
