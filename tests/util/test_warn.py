"""Work that is quiet on one thread leaves the warnings and the output of others alone."""

import sys
import threading
import warnings
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np

import bdamper as bd
from bdamper.harmonic_balance.problem import Problem
from bdamper.importers.fe_body import reader
from bdamper.importers.measurements import read_measurements
from bdamper.time_domain.integration import every_diameter
from bdamper.util.errors import quiet, warn

LONG = 30.0  # s


class Pause:
    """Holds a thread inside of something until another one lets it go on."""

    def __init__(self):
        self.inside, self.go = threading.Event(), threading.Event()

    def __call__(self):
        self.inside.set()
        assert self.go.wait(LONG)


def heard_beside(work, pause, speak):
    """The warnings that are heard of what is said while some work is held inside on another thread."""
    with warnings.catch_warnings(record=True) as heard, ThreadPoolExecutor(1) as pool:
        warnings.simplefilter("always")
        done = pool.submit(work)
        assert pause.inside.wait(LONG)
        try:
            speak()
        finally:
            pause.go.set()
        done.result(LONG)
    return [str(warning.message) for warning in heard]


def test_quiet_is_of_one_thread():
    pause = Pause()

    def work():
        with quiet():
            warn("inside")
            pause()
        warn("after")

    assert heard_beside(work, pause, lambda: warn("beside")) == ["beside", "after"]


def test_a_reader_leaves_the_warnings_of_others(tmp_path):
    pause = Pause()

    @reader("a file of this test")
    def read(path):
        pause()
        return np.float64(1e300) * np.float64(1e300)  # damaged numbers overflow without a warning

    (tmp_path / "file").write_text("")
    said = [f"warning {k}" for k in range(50)]
    heard = heard_beside(
        lambda: read(tmp_path / "file"),
        pause,
        lambda: [warnings.warn(t, stacklevel=1) for t in said],
    )
    assert heard == said


def test_all_diameters_are_made_without_warnings_and_leave_those_of_others(monkeypatch):
    study = bd.Study(bd.reference_model("turbine_blade"), bd.Excitation("tip"), 5, 0.3, harmonics=2)
    pause, with_ = Pause(), Problem.replace

    def slow(problem, **changes):
        pause()
        warn("of a problem that nobody asked for")
        return with_(problem, **changes)

    monkeypatch.setattr(Problem, "replace", slow)
    said = [f"warning {k}" for k in range(50)]
    assert (
        heard_beside(
            lambda: every_diameter(study.problem), pause, lambda: [warn(text) for text in said]
        )
        == said
    )


def test_a_universal_file_leaves_the_output_of_others(tmp_path, monkeypatch, capsys):
    pause = Pause()

    class File:
        def __init__(self, name):
            pause()

        def get_set_types(self):
            return [58]

        def read_sets(self, k):
            return {"x": [1.0, 2.0], "data": [1.0, 0.5]}

    monkeypatch.setitem(sys.modules, "pyuff", SimpleNamespace(UFF=File))
    (tmp_path / "a.unv").write_text("")
    heard_beside(lambda: read_measurements(tmp_path / "a.unv"), pause, lambda: print("beside"))
    assert capsys.readouterr().out == "beside\n"
