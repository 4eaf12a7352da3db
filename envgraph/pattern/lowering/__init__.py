"""From bodies as they are written to the resolved goals that matchers compile."""
