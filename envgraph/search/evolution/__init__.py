"""The genetic algorithm with mutation, parent and survivor selection; and archives filled by random walks."""
