"""Whether the highest points of random studies of a few masses are reached by slow sweeps of frequency in time.

``python -m benchmarks.bench_reached [studies]`` draws that many studies (500 by default, ``tests/sweeps.py``) and asks each
for a response curve and a peak with seven harmonics.  Plain NumPy integrates slow sweeps up and down the same band from
rest.
It prints how many highest points lie more than 5 % above both sweeps, with their numbers, and how many lie below the higher
sweep.  The latter leaves out curves whose highest response is at an end, which is no peak.
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray

from tests.sweeps import draw, highest_in_sweeps

STUDIES, HARMONICS, TOLERANCE = 500, 7, 0.05


def report(name: str, heights: NDArray, swept: NDArray, flank: NDArray) -> None:
    """One line for response curves or peaks, NaN where there is none."""
    ratio = heights / swept
    above = np.flatnonzero(ratio > 1.0 + TOLERANCE)
    below = (ratio < 1.0 - TOLERANCE) & ~flank
    listed = ", ".join(f"{i} ({ratio[i]:.3g} times)" for i in above)
    print(
        f"{name}: {np.isfinite(ratio).sum()} studies, {len(above)} above both sweeps [{listed}], {below.sum()} below"
    )


def main() -> None:
    """Draw, ask, integrate and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_reached", description=__doc__)
    parser.add_argument("studies", nargs="?", type=int, default=STUDIES)
    drawn = [draw(number) for number in range(parser.parse_args().studies)]
    swept = highest_in_sweeps(drawn)
    heights, flank = np.full((2, len(drawn)), np.nan), np.zeros(len(drawn), bool)
    for i, one in enumerate(drawn):
        study = one.study(harmonics=HARMONICS)
        curve, peak = study.frequency_response(0.0, one.band), study.peak(0.0, one.band)
        heights[:, i] = curve.peak.amplitude, peak.amplitude if peak.ok else np.nan
        flank[i] = curve.peak_at_end
    apart = np.abs(swept[:, 0] / swept[:, 1] - 1.0) > TOLERANCE
    print(f"{len(drawn)} studies, of which {apart.sum()} have other heights upward than downward")
    report("response curves", heights[0], swept.max(axis=1), flank)
    report("peaks", heights[1], swept.max(axis=1), flank)


if __name__ == "__main__":
    main()
