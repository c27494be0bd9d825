"""The sign that a damper rattles, on curves given point by point."""

import numpy as np

from bdamper.response.response_curve import FOLDS, OPEN
from bdamper.response.response_curve import rattles as sign_of


class Points:
    """A curve given point by point."""

    def __init__(self, frequency, amplitude, share_open, branch=None):
        self.frequency, self.amplitude = np.asarray(frequency, float), np.asarray(amplitude, float)
        self.branch = np.zeros(len(self.frequency)) if branch is None else branch
        self.shares = np.outer(share_open, [0.0, 0.0, 1.0])

    def __len__(self):
        return len(self.frequency)


def rattles(*points, at_rest=0.0):
    return sign_of(Points(*points), at_rest)


def zigzag(folds):
    """Frequencies that turn so many times, three points a way."""
    return np.cumsum(np.repeat((-1.0) ** np.arange(folds + 1), 3))


def test_many_folds_with_contacts_open_at_the_highest_point():
    omega = zigzag(FOLDS)
    height = np.arange(len(omega), dtype=float)
    share = np.where(height == height.max(), OPEN + 0.3, 0.0)
    why = rattles(omega, height, share)
    assert (
        why == f"{FOLDS} folds, and the contacts open for 80 % of the cycle at the highest response"
    )
    assert not rattles(omega, -height, share), "open at the lowest point alone"
    assert not rattles(omega, height, OPEN * share / share.max()), "open for half of the cycle"
    assert not rattles(omega, height, share, at_rest=0.61), "half of what is closed at rest"
    assert rattles(omega, height, share, at_rest=0.59)
    assert not rattles(zigzag(FOLDS - 1), height[:-3], share[3:]), "a fold less"
    assert not rattles([], [], [])


def test_jumps_between_branches_are_no_folds():
    omega = np.tile(np.arange(4.0), FOLDS + 1)
    branch = np.repeat(np.arange(FOLDS + 1), 4)
    assert rattles(omega, omega, np.ones(len(omega)))
    assert not rattles(omega, omega, np.ones(len(omega)), branch)
