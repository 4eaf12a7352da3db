"""What is added to a program to act as a network says that sees the components of an observation as one-hot vectors.

Part of the program's text, between `values` and `_playing`. All sums begin with the bias and go on in the order of
the inputs, so that they are the same with numba and without.
"""

# ruff: noqa: F821
# mypy: ignore-errors

from math import exp


def outputs(C, FIRSTS, W, SIZES, X):
    """Write the units of all layers, one layer behind the other, before rectification; where the last one begins.

    `W` has the bias and the weights [inputs, outputs] of each layer, `SIZES` the inputs and the outputs of each.
    """
    place, at, size = 0, 0, SIZES[1]
    for unit in range(size):
        X[unit] = W[unit]
    for number in range(len(FIRSTS)):
        row = (1 + FIRSTS[number] + C[number]) * size
        for unit in range(size):
            X[unit] += W[row + unit]
    for layer in range(2, len(SIZES)):
        at += (1 + SIZES[layer - 2]) * size
        following, before, size = place + size, size, SIZES[layer]
        for unit in range(size):
            X[following + unit] = W[at + unit]
        for number in range(before):
            value, row = max(X[place + number], 0.0), at + (1 + number) * size
            for unit in range(size):
                X[following + unit] += value * W[row + unit]
        place = following
    return place


def softmax(X, first, actions, u):
    """One of the actions whose preferences begin at a place, as a number in [0, 1) decides."""
    best, total = X[first + greedy(X, first, actions)], 0.0
    for place in range(first, first + actions):
        X[place] = exp(X[place] - best)
        total += X[place]
    rest = u * total
    for action in range(actions - 1):
        rest -= X[first + action]
        if rest < 0.0:
            return action
    return actions - 1


def decide(T, G, L, K, S, F, BITS, RI, RF, D, m, R, C, POLICY):
    """What the network does, and whether it has drawn that; -1 after an error."""
    FIRSTS, W, SIZES, X, DRAWS = POLICY
    if S[0, 0] == 0:
        look(T[m], G[m], L, K, S[0], F[0], RI, RF, D, 0, C[0])
    if S[0, 0] != 0:
        return -1, False
    actions = SIZES[len(SIZES) - 1]
    first = outputs(C[0], FIRSTS, fixed(W)[0], SIZES, vector(X))
    if DRAWS:
        return softmax(vector(X), first, actions, uniform(R, 0)), True
    return greedy(vector(X), first, actions), False
