"""Statuses: one set of words."""

import json
from dataclasses import replace

import h5py

import bdamper as bd
from bdamper.response.verification import FrictionPeak, TimeResponse
from bdamper.util import errors
from bdamper.util.errors import (
    STATUSES,
    Ending,
    all_complete,
    not_run_lines,
    separated,
    with_reason,
)
from bdamper.util.records import from_json, with_separate_reasons


def test_words_are_those_of_the_docstring_and_stay_as_they_are():
    assert all(f'"{one}"' in errors.__doc__ for one in STATUSES) and len(set(STATUSES)) == len(
        STATUSES
    )


def test_reasons():
    assert (
        with_reason("failed", ValueError("no")) == "failed: no"
        and with_reason("complete") == "complete"
    )
    assert separated("failed: no: none") == ("failed", "no: none")


def test_of_several():
    assert all_complete(("complete", "complete")) and not all_complete(("complete", "incomplete"))
    statuses = ("complete", "not run", "not run")
    assert not_run_lines(statuses, ("", "broken", ""), "points") == [
        "  interrupted: 2 of 3 points were not run: broken"
    ]
    assert not_run_lines(("complete", "failed"), ("", "not run"), "points") == []


def test_a_result_with_a_reason():
    end = Ending("incomplete", "a gap: 1 to 2 Hz")
    assert not end.ok and end.status_text == "incomplete: a gap: 1 to 2 Hz"
    assert Ending().ok and Ending().status_text == "complete"


def joined(file, name):
    """Write the status of a result as version 0.10 did: followed by its reason."""
    status = file.attrs[f"{name}status"].decode()
    reason = file.attrs[f"{name}reason"].decode()
    file.attrs[f"{name}status"] = f"{status}: {reason}"
    del file.attrs[f"{name}reason"]


def test_files_of_version_0_10(tmp_path):
    """They have a status and its reason in one text, also in parts of a result."""
    contact = bd.Contact(normal=0, kn=3.0, preload=5.0)
    study = bd.lumped([1.0], [0.3], [1.0], contacts=[contact], forces={0: 0.1}, harmonics=1)
    peak = study.peak(0.0, (0.05, 0.06))
    assert peak.status == peak.search_status == "incomplete"
    path = tmp_path / "peak.h5"
    peak.save(path)
    with h5py.File(path, "r+") as file:
        joined(file, "")
        joined(file, "search_")
        assert file.attrs["status"].startswith("incomplete: highest at an end")
    old = bd.load(path)
    assert (old.status, old.reason) == (peak.status, peak.reason)
    assert (old.search_status, old.search_reason) == (peak.search_status, peak.search_reason)

    part = {"factor": 0.7, "preload": 10.0, "amplitude": 2.0, "status": "incomplete: why"}
    (friction_peak,) = from_json(tuple[FrictionPeak, ...], [part])
    assert (friction_peak.status, friction_peak.reason) == ("incomplete", "why")
    assert friction_peak.lower_bound == 2.0

    # a motion had one reason for its verdict and another one in its status
    verdict = {"status": "incomplete: undecided", "reason": "+1 % in 5 periods"}
    assert with_separate_reasons(verdict, ("status", "reason")) == {
        "status": "incomplete",
        "reason": "+1 % in 5 periods",
    }


def test_files_with_a_static_state_of_version_0_10(tmp_path):
    """They have the outcome of the static state as ``converged`` and ``note``."""
    contact = bd.Contact(normal=0, kn=3.0, preload=5.0)
    study = bd.lumped([1.0], [0.3], [1.0], contacts=[contact], forces={0: 0.1}, harmonics=1)
    state = replace(study.static(0.0), ok=False, reason="no equilibrium")
    path = tmp_path / "static.h5"
    state.save(path)
    with h5py.File(path) as file:
        assert json.loads(file["converged"][()]) is False
        assert file.attrs["note"] == b"no equilibrium"
    again = bd.load(path)
    assert not again.ok and again.reason == "no equilibrium"


def test_a_jump_is_stored_under_its_former_name(tmp_path):
    """Files of version 0.10 have the frequency of a jump as ``fall``."""
    response = TimeResponse(1e-4, 1e-4, 1e-4, 354.17, 4e3, 2e-4, jump_frequency=354.24)
    path = tmp_path / "response.h5"
    response.save(path)
    with h5py.File(path) as file:
        assert file.attrs["fall"] == 354.24 and "jump_frequency" not in file.attrs
    assert bd.load(path).jump_frequency == 354.24


def test_tables_and_optima_are_ok_if_all_parts_are():
    contact = bd.Contact(normal=0, kn=3.0, preload=5.0)
    study = bd.lumped([1.0], [0.05], [1.0], contacts=[contact], forces={0: 0.1}, harmonics=1)
    task = bd.PeakTask(preload=0.0, frequency=(0.2, 0.4))
    swept = bd.sweep(study, {"excitation.amplitude": [0.1, 0.2]}, task)
    assert swept.ok and swept.status == ("complete", "complete")
    assert not replace(swept, status=("complete", "failed: why")).ok


def test_rows_of_version_0_10_have_their_reason_apart():
    joined = {"status": ("complete", "failed: no: none"), "curve_status": ("not asked",)}
    names = ["status", "reason", "curve_status", "curve_reason"]
    assert with_separate_reasons(joined, names) == {
        "status": ("complete", "failed"),
        "reason": ("", "no: none"),
        "curve_status": ("not asked",),
        "curve_reason": ("",),
    }
