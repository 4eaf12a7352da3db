"""What is added to a program to say which actions do something: the masks of a batch.

Part of the program's text, behind `kernels`.
"""

# ruff: noqa: F821
# mypy: ignore-errors


def masks(W, ALLOWED, ACTIONS):
    """Whether each action would do something in each environment [environments * actions], 0 or 1.

    What would be an error is for `step_one` to tell, so it counts as done.
    """
    T, G, L, S, F, RI, RF, D, M, _, _, _, _, _, _, _, _, _, _, _, _, _ = arrays_at(W)
    K = places(L)
    for place in range(len(ALLOWED)):
        e, action = place // ACTIONS, place % ACTIONS
        m = M[e]
        ALLOWED[place] = may_one(T[m], G[m], L, K, S[e], F[e], RI, RF, D, 0, action)
        S[e, 0] = 0
