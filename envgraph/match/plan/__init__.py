"""Search plans: the goals of a body in the order that promises the least work."""
