"""Code that is added to a program to compute the action masks of a batch.

Part of the program's text, behind `kernels` and `_scripted_choices`.
"""

# ruff: noqa: F821
# mypy: ignore-errors


def masks(W, ALLOWED, OWN, AGENTS, D):
    """Write True into `ALLOWED` [environments, actions] for actions that would have an effect, else False.

    A joint action is allowed if the action of each of the `AGENTS` is; of an agent without such an action all are
    allowed. `OWN` is a buffer with an entry for each action of an agent. An action that would raise an error counts as
    having an effect, so that `step_one` raises the error. Errors that the tests store in the states are cleared. The
    script `D` decides the choices of units.
    """
    T, G, L, S, F, RI, RF, _, M, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, Q = arrays_at(W)
    K, own = places(L), len(OWN)
    ALLOWED, OWN, D = matrix(ALLOWED), vector(OWN), vector(D)
    for e in range(Q[0]):
        m, size = M[e], 1
        ALLOWED[e, 0] = True
        for agent in range(AGENTS):
            some = False
            for action in range(own):
                OWN[action] = may_one(T[m], G[m], L, K, S[e], F[e], RI, RF, D, 0, agent * own + action) != 0
                some = some or OWN[action]
                S[e, 0] = 0
            for action in range(own - 1, -1, -1):  # last the action 0, whose entries are those that are read
                allowed = OWN[action] or not some
                for place in range(size):
                    ALLOWED[e, action * size + place] = allowed and ALLOWED[e, place]
            size *= own
