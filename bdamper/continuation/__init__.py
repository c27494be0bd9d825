"""Response curves: how they start, how they are followed, and which parts of an interval they cover.

In: a :class:`bdamper.problem.problem.Problem`, a preload and a frequency interval.  Out: a `Curve` with all branches that
were found, its status and what was left out.  `find_start` gives a solution at one frequency, `follow` a path through folds
from there, `Coverage` collects paths until they cover an interval or the budget of evaluations is used up; `track.track`
does all three, `linear_curve` gives the curves of free and of stuck contact.  Units of steps are explained in `follower`.
"""

from bdamper.continuation.coverage import Coverage
from bdamper.continuation.curve import Curve, Fold
from bdamper.continuation.follower import follow
from bdamper.continuation.path import ContinuationOptions, Path, PathPoint
from bdamper.continuation.track import check_curve, find_start

__all__ = [
    "ContinuationOptions",
    "Coverage",
    "Curve",
    "Fold",
    "Path",
    "PathPoint",
    "check_curve",
    "find_start",
    "follow",
]
