"""What the values of actions say, a row of them: which is best, which is taken. Part of the texts of learners.

The row of double Q-learning has two values of each action, the second ones behind the first, whose sum says what is
best; all others have one. Loops on lists call these as they are.
"""

# mypy: ignore-errors


def best_of(row, actions):
    """The greatest value: a chain of maxima, which is quicker than finding the action first."""
    best = row[0]
    for action in range(1, actions):
        best = max(best, row[action])
    return best


def mean_of(row, actions, epsilon):
    """The value of what an agent does that explores so often."""
    total = 0.0
    for action in range(actions):
        total += row[action]
    return (1.0 - epsilon) * best_of(row, actions) + epsilon * (total / actions)


def greedy(row, first, actions):
    """The best of the actions whose values begin at a place, the lowest of equals."""
    found = 0
    for action in range(1, actions):
        if row[first + action] > row[first + found]:
            found = action
    return found


def worth(row, action, actions):
    """The value of an action, or the sum of both."""
    return row[action] if len(row) == actions else row[action] + row[actions + action]


def drawn_of(share, count):
    """One of so many things by a number in [0, 1), and what is left of that: another such number."""
    place = min(int(share * count), count - 1)
    return place, share * count - place


def drawn_action(row, actions, u, epsilon, ties):
    """What an agent does that explores so often, as `u` decides; and a number in [0, 1) that is still free.

    The lowest of the best actions; with `ties` each of them is as likely.
    """
    if u < epsilon:
        return drawn_of(u / epsilon, actions)
    found, count, best = 0, 1, worth(row, 0, actions)
    for action in range(1, actions):
        value = worth(row, action, actions)
        if value > best:
            found, count, best = action, 1, value
        elif value == best:
            count += 1
    place, free = drawn_of((u - epsilon) / (1.0 - epsilon), count if ties else 1)
    while place > 0:
        found += 1
        place -= worth(row, found, actions) == best
    return found, free
