"""The genetic algorithm: mutations, selection, generations; and archives that random walks fill."""
