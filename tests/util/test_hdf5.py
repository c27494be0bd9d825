"""Every result refuses what is not a file of it, with one error that says so."""

import h5py
import pytest

import bdamper as bd
from bdamper.continuation.curve import load_curve
from bdamper.design.sweep import load_sweep
from bdamper.design.uncertainty import load_uncertain_curve
from bdamper.effects.advice import load_advice
from bdamper.peaks.optimal import load_optimal_curve

READERS = [
    (load_curve, "bdamper-curve", "Curve.save"),
    (load_optimal_curve, "bdamper-optimal", "OptimalCurve.save"),
    (load_sweep, "bdamper-sweep", "SweepResult.save"),
    (load_uncertain_curve, "bdamper-uncertain", "UncertainCurve.save"),
    (load_advice, "bdamper-advice", "Advice.save"),
]


@pytest.mark.parametrize(("load", "kind", "writer"), READERS, ids=lambda v: getattr(v, "__name__", ""))
def test_what_is_no_such_file_is_refused(tmp_path, load, kind, writer):
    path = tmp_path / "result.h5"
    with pytest.raises(FileNotFoundError):
        load(path)
    path.write_bytes(b"not HDF5")
    with pytest.raises(bd.BdamperError, match=rf"{path}: expected .* written by {writer}, found something else"):
        load(path)
    with h5py.File(path, "w") as file:
        file.attrs["format"] = "other"
    with pytest.raises(bd.BdamperError, match=rf"{path}: expected the format '{kind}', found 'other'"):
        load(path)
    with h5py.File(path, "w") as file:
        file.attrs["format"] = kind
    with pytest.raises(bd.BdamperError, match="found something else"):
        load(path)
