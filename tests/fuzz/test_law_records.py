"""Records of contact laws with counts, ranges and names that do not fit: refused, or computed within their memory.

Records reach the core in files, in pickles and in calls of the core.  What is still accepted is evaluated, so that
AddressSanitizer sees each read and write (``make sanitize``).  ``BDAMPER_FUZZ`` sets the number of cases.
"""

import json
import os
import pickle

import h5py
import numpy as np
import pytest

import bdamper as bd
from bdamper import _core

CASES = int(os.environ.get("BDAMPER_FUZZ", "150"))
LAWS = (
    bd.ContactLaw.jenkins([0.4, 0.6], [0.2, 0.5], 0.1, kn=2.0),
    bd.ContactLaw.iwan(1.0, 1.0, -0.5, 0.2, n=4),
    bd.ContactLaw.bouc_wen(1.0, 0.1, 2.0, 0.5, 1.5, kn=1.0),
)
NUMBERS = (
    0,
    1,
    2,
    3,
    5,
    6,
    8,
    -1,
    0.5,
    50,
    5000,
    3333,
    1e5,
    -0.0,
    1e-308,
    1e300,
    2**31,
    2**63,
    float("nan"),
    float("inf"),
)
OTHERS = (None, True, "2", [], [[1.0], [1.0, 2.0]], {}, "iwan", "bouc_wen", "jenkins")


def changed(record, rng):
    """The record with one to three changes of counts, numbers and kinds."""
    record = json.loads(json.dumps(record))
    for _ in range(int(rng.integers(1, 4))):
        key = str(
            rng.choice(
                ["parameters", "parameters", "n_state", "contact_law", "stick", "resolution"]
            )
        )
        value, number = record.get(key), NUMBERS[rng.integers(len(NUMBERS))]
        kind = int(rng.integers(6))
        if kind == 0:
            record.pop(key, None)
        elif kind == 1:
            record[key] = OTHERS[rng.integers(len(OTHERS))]
        elif not isinstance(value, list):
            record[key] = (
                ("jenkins", "iwan", "bouc_wen")[rng.integers(3)] if key == "contact_law" else number
            )
        elif kind == 2:
            record[key] = value[: rng.integers(len(value) + 1)]
        elif kind == 3:
            record[key] = value + [number] * int(rng.integers(1, 9))
        elif kind == 4:
            record[key] = [value] * int(rng.integers(1, 4))
        elif value:
            value[rng.choice([0, rng.integers(len(value))])] = number
    return record


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    contact = bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)
    study = bd.lumped(
        1.0, 0.02, 1.0, contacts=[contact], forces={0: 0.4}, harmonics=1, friction_law=LAWS[0]
    )
    path = tmp_path_factory.mktemp("laws") / "study.h5"
    study.save(path)
    return path


def write(path, record):
    with h5py.File(path, "r+") as f:
        settings = json.loads(f["settings"][()])
        settings["friction_law"] = record
        del f["settings"]
        f["settings"] = json.dumps(settings)


class Pickled:
    """Pickles as the law of a record."""

    def __init__(self, record):
        self.record = record

    def __reduce__(self):
        return bd.ContactLaw.of_record, (self.record,)


def outcome(make):
    """What was made, or None for an error of one line."""
    try:
        return make()
    except bd.BdamperError as error:
        if "\n" in str(error):
            raise
        return None


@pytest.mark.slow
@pytest.mark.timeout(300 + CASES)
@pytest.mark.filterwarnings("ignore")
def test_records(file):
    accepted = refused = 0
    for case in range(CASES):
        rng = np.random.default_rng([65, case])
        record = changed(LAWS[case % len(LAWS)].record(), rng)
        law = outcome(lambda: pickle.loads(pickle.dumps(Pickled(record))))
        if case % 5 == 0:
            write(file, record)
            study = outcome(lambda: bd.load_study(file))
            assert study is None or law is not None
            if study is not None and outcome(lambda: study.static(0.5)) is not None:
                outcome(
                    lambda: study.problem.system(0.5).evaluate(
                        np.full(study.problem.n_unknowns, 0.3), 1.0
                    )
                )
        accepted, refused = accepted + (law is not None), refused + (law is None)
    assert accepted > 0.05 * CASES and refused > 0.3 * CASES


@pytest.mark.timeout(300 + CASES)
def test_calls_of_the_core():
    """Random counts of parameters and states: an error, or a step within its arrays."""
    rng, done = np.random.default_rng(66), 0
    zero = np.zeros(2)
    for _ in range(CASES):
        function = (_core.jenkins, _core.bouc_wen)[rng.integers(2)]
        p = np.array([float(x) for x in rng.choice(NUMBERS, size=rng.integers(0, 14))])
        p[1:] = np.where(rng.random(max(len(p) - 1, 0)) < 0.9, 0.5, p[1:])
        memory = np.zeros((1, 3 + int(rng.integers(0, 9))))
        if rng.random() < 0.3 and len(p) > 5:
            p, memory = p[: 2 + 3 * ((len(p) - 2) // 3)], np.zeros((1, 3 + 2 * ((len(p) - 2) // 3)))
            p[0] = (len(p) - 2) // 3
        law = ((function, p, memory[0].copy()),)
        x, F, J = np.full((3, 3), 0.3), np.empty((3, 3)), np.empty((3, 3, 3, 3))
        try:
            _core.step_laws(
                law, np.ones((1, 3)), memory, memory.copy(), np.zeros((1, 3)), np.zeros((1, 3, 3))
            )
            _core.evaluate_contact(x, zero, 0.0, 0.0, 0.0, zero, F, J, 7, 1, 16, own=law)
        except ValueError:
            continue
        done += 1
    assert 0 < done < 0.7 * CASES
