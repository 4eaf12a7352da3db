"""The model for users and for programs, handles of its objects, its conformance and its pictures."""
