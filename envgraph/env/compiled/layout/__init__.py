"""The tables of members and the columns of states: what they contain, and where they are in the arrays."""
