"""Several designs on the same axes."""

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest

import bdamper as bd
from bdamper.design import compare
from bdamper.io import Measurement
from bdamper.plot import plot_together
from bdamper.util.text import amount
from tests.plain import plain_study

INTERVAL = (350.0, 358.0)
DESIGNS = {"smooth": {"friction_coefficient": 0.2}, "heavier": {"damper_mass_factor": 1.5}}


@pytest.fixture(scope="module")
def study():
    model = bd.reference_model("bladed_disk", 9)
    return plain_study(model, bd.Excitation("tip"), engine_order=5, friction_coefficient=0.4)


@pytest.fixture(scope="module")
def found(study):
    return study.compare_designs(DESIGNS, 4000.0, INTERVAL)


def test_each_design_has_its_own_curve(study, found, tmp_path):
    assert found.names == ("as it is", "smooth", "heavier")
    alone = study.with_(friction_coefficient=0.2).track(4000.0, INTERVAL)
    assert found.results["smooth"].peak.amplitude == pytest.approx(alone.peak.amplitude, rel=1e-9)
    assert found.differences["smooth"].settings[0] == ("friction_coefficient.left", 0.4, 0.2)
    assert [name for name, *_ in found.differences["heavier"].settings] == ["model"]
    assert found.columns()["design"].values.tolist().count("smooth") == len(alone)
    text = found.details().splitlines()
    assert text[2].startswith("smooth") and amount(alone.peak.amplitude, "m") in text[2] and text[2].endswith("complete")
    found.save(tmp_path / "designs.h5")
    assert str(bd.load(tmp_path / "designs.h5")) == str(found)


def test_on_the_same_axes(study, found):
    measured = Measurement("rig", np.array([352.0, 354.0]), np.array([0.5, 0.7j]), unit="mm")
    ax = found.plot(measured=[measured])
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    assert {"as it is", "smooth", "heavier", "rig"} <= set(names)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Frequency (Hz)", "Tip amplitude (µm)")
    losses = plot_together({name: study.dissipation(curve) for name, curve in list(found.results.items())[:1]})
    assert losses.get_ylabel() == "Equivalent damping ratio (%)"
    loops = plot_together({"a": study.hysteresis(found.curves[0]), "b": study.hysteresis(found.curves[0], 0)})
    assert loops.get_ylabel() == "All contact forces as one force there (N)" and len(loops.get_lines()) == 2
    assert loops.get_xlabel() == "Motion of the response (µm)"
    mass = bd.lumped(1.0, 0.02, 1.0, contacts=[bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)], forces={0: 1.0})
    far = plot_together({"a mass": mass.hysteresis(mass.peak(0.0, (0.1, 0.3)))})
    assert far.get_xlabel() == "Motion of the response (m)" and np.abs(far.get_lines()[0].get_xdata()).max() < 10.0
    plt.close("all")


def test_optimal_curves(study, monkeypatch):
    curve = study.optimal_curve((6e3, 8e3), 2, frequency=(340.0, 370.0), check=False)
    monkeypatch.setattr(compare, "optimal_curve", lambda *_, **__: curve)
    found = study.compare_designs({"smooth": {"friction_coefficient": 0.39}}, (6e3, 8e3), n=2, name="rough")
    assert found.names == ("rough", "smooth") and not found.curves and len(found.optimal) == 2
    ax = found.plot("shift")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Preload (N)", "Frequency shift (%)")
    assert found.plot().get_ylabel() == "Resonance amplitude (µm)"
    plt.close("all")


def test_interrupted_work_keeps_what_there_is(study, found, monkeypatch):
    class Stopped:
        interrupted = True

    answers = iter([found.curves[0], Stopped()])
    monkeypatch.setattr(compare, "track", lambda *_: next(answers))
    assert study.compare_designs(DESIGNS, 4000.0, INTERVAL).names == ("as it is", "smooth")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([], 4000.0), "designs: expected a mapping of one or more names to studies or settings"),
        (({"a": 3}, 4000.0), "design 'a': expected a study or a mapping of settings, found 3"),
        (({"a": {"frictoin": 3}}, 4000.0), "frictoin"),
        (({"as it is": {}}, 4000.0), "name: expected a name that no other design has"),
        ((DESIGNS, -1.0), "preload: expected"),
        ((DESIGNS, 4000.0, (3.0, 2.0)), "frequency: expected"),
    ],
)
def test_what_does_not_fit_is_refused_before_any_work(study, arguments, message, monkeypatch):
    monkeypatch.setattr(compare, "track", None)
    with pytest.raises(bd.SettingError, match=message):
        study.compare_designs(*arguments)


def test_results_of_several_kinds_are_refused(study, found):
    with pytest.raises(bd.SettingError, match="results: expected tracking curves, optimal curves, dissipations or"):
        plot_together({"a": found.curves[0], "b": study.dissipation(found.curves[0])})
    with pytest.raises(bd.SettingError, match=r"quantity: expected one of \('amplitude',\), found 'shift'"):
        found.plot("shift")
