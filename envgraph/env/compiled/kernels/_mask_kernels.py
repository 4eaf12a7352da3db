"""Code that is added to a program to compute the action masks of a batch.

Part of the program's text, behind `kernels` and `_scripted_choices`.
"""

# ruff: noqa: F821
# mypy: ignore-errors


def masks(W, ALLOWED, ACTIONS, D):
    """Write True into `ALLOWED` [environments * actions] for actions that would have an effect, else False.

    An action that would raise an error counts as having an effect, so that `step_one` raises the error. Errors that the
    tests store in the states are cleared. The script `D` decides the choices of units.
    """
    T, G, L, S, F, RI, RF, _, M, _, _, _, _, _, _, _, _, _, _, _, _, _ = arrays_at(W)
    K, D = places(L), vector(D)
    for place in range(len(ALLOWED)):
        e, action = place // ACTIONS, place % ACTIONS
        m = M[e]
        ALLOWED[place] = may_one(T[m], G[m], L, K, S[e], F[e], RI, RF, D, 0, action)
        S[e, 0] = 0
