"""Lower bodies of patterns to the resolved goals that matchers compile."""
