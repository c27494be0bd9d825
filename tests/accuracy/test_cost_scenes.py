"""The benchmark of docs/accuracy.md takes its optima from curves that span the band."""

import numpy as np
import pytest

import bdamper as bd

bench_cost = pytest.importorskip("benchmarks.bench_cost", reason="the benchmarks stand beside the source alone")


@pytest.mark.slow
def test_the_least_peak_is_never_that_of_an_incomplete_curve(monkeypatch):
    """At 37.97 N (friction 0.4, engine order 10) the curve ends at 287.6 Hz, lower than any resonance: 20 of 34 µm."""
    preloads = np.array([37.96543782323048, 76.94668000744166])
    monkeypatch.setattr(bench_cost, "PRELOADS", preloads)
    short, whole = (bench_cost.tracked(bench_cost.study(0.4, 10), p)[0] for p in preloads)
    assert not short.complete and short.frequency.max() < 290.0 and short.amplitude.max() < whole.peak.amplitude
    assert whole.complete and not whole.peak_at_end
    assert bench_cost.least(0.4, 10) == preloads[1]
    monkeypatch.setattr(bench_cost, "PRELOADS", preloads[:1])
    with pytest.raises(bd.BdamperError, match="no curve is complete and has a peak"):
        bench_cost.least(0.4, 10)
