"""Response curves: how they start, how they are followed, and which parts of an interval they cover.

In: a :class:`bdamper.problem.problem.Problem`, a preload and a frequency interval.  Out: a `Curve` with all branches that
were found, its status and what was left out.  `start` finds a solution at one frequency, `follower` follows a path through
folds from there, `Coverage` collects paths until they cover an interval or the budget of evaluations is used up;
`track.track` does all three, `linear_curve` gives the curves of free and of stuck contact.
"""
