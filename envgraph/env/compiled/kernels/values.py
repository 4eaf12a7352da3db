"""Read a row of action values: best value, sampled action. The text of this module is part of learning programs.

For double Q-learning a row has two values of each action, first all first values, then all second ones; their sum
determines the best action. Other methods have one value of each action. Python calls the functions on lists, too.
"""

# mypy: ignore-errors


def best_of(row, actions):
    """Return the greatest value; a chain of maxima is faster than finding the action first."""
    best = row[0]
    for action in range(1, actions):
        best = max(best, row[action])
    return best


def mean_of(row, actions, epsilon):
    """Return the expected value of an epsilon-greedy action: the best with probability 1 - epsilon, else any."""
    total = 0.0
    for action in range(actions):
        total += row[action]
    return (1.0 - epsilon) * best_of(row, actions) + epsilon * (total / actions)


def greedy(row, first, actions):
    """Return the action with the greatest of the values from `row[first]` on; the lowest action of equal ones."""
    found = 0
    for action in range(1, actions):
        if row[first + action] > row[first + found]:
            found = action
    return found


def worth(row, action, actions):
    """Return the value of an action, or for double Q-learning the sum of its two values."""
    return row[action] if len(row) == actions else row[action] + row[actions + action]


def drawn_of(share, count):
    """Return a number below `count` selected by `share` in [0, 1), and the remainder, a new number in [0, 1)."""
    place = min(int(share * count), count - 1)
    return place, share * count - place


def drawn_action(row, actions, u, epsilon, ties):
    """Sample an epsilon-greedy action from the random number `u`; return it and a random number still unused.

    Of equally good actions the lowest is chosen, or, with `ties`, each with the same probability.
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
