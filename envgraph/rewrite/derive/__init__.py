"""Rules that a metamodel implies: `derive name = operators for Class;` and its like."""
