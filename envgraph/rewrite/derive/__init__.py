"""Rules generated from a metamodel, as in `derive name = operators for Class;`."""
