"""Functions, added to a program's text, that choose actions by a neural network on one-hot encoded observations.

In the text they follow `values` and precede `_playing`. Each sum starts with the bias and adds the inputs in order, so
that results are equal with numba and without.
"""

# ruff: noqa: F821
# mypy: ignore-errors

from math import exp


def outputs(C, FIRSTS, W, SIZES, X):
    """Write the outputs of all layers, before rectification, to `X`; return where the last layer begins.

    `W` contains the bias and the weights [inputs, outputs] of each layer; `SIZES` contains the sizes of all layers.
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
    """Sample an action with the softmax of the preferences at `X[first:first + actions]`, decided by `u` in [0, 1).

    The preferences in `X` are overwritten.
    """
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
    """Return the action of the network and True if the action was sampled; return (-1, False) after an error."""
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
