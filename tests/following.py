"""A peak followed through given values of a parameter."""

from typing import NamedTuple

from bdamper.peaks.follower import PeakFollower


class Followed(NamedTuple):
    """Peaks at the values, as far as they exist, the last value up to which the peak was followed, and how it ended."""

    peaks: tuple
    ended: float
    status: str
    reason: str


def follow_peak(family, start, values):
    follower, peaks = PeakFollower(family, start), []
    for value in values:
        peak = follower.go(float(value))
        if peak is None:
            break
        peaks.append(peak)
    return Followed(tuple(peaks), follower.known[-1].parameter, follower.status, follower.reason)
