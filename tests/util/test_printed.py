"""What results print: short, and true of the result."""

import copy
import doctest
import importlib
import inspect
import pkgutil
import re
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses.response_residuals import MeasuredResponse
from bdamper.analyses.robust_optimum import RobustOptimum
from bdamper.analyses.sweep import as_words
from bdamper.contact.static_contact import WedgeFriction
from bdamper.importers import FEBody
from bdamper.mistuning import BladedDisk, DamperVariation, Mistuning
from bdamper.mistuning.sample import BestPreload
from bdamper.mistuning.statistics import WeibullTail
from bdamper.response.optimum_checks import NEAR_BEST, checks
from bdamper.response.peak_error import error_text
from bdamper.response.sensitivity import PeakSensitivity, Sensitivities
from bdamper.response.verification import Convergence, FrictionPeak, HarmonicPeak, TimeResponse
from bdamper.util import display
from bdamper.util.display import Fact, Summarised, _kinds
from bdamper.util.formatting import amount, span, table_lines
from bdamper.util.progress import LongWork, shows_progress
from tests.each import each
from tests.mistuning.lumped import lumped_study
from tests.plain import plain_study
from tests.printed import check as printed_check
from tests.printed import row, said, value

INTERVAL = (270.0, 380.0)


@pytest.fixture(scope="module")
def study():
    model = bd.reference_model("bladed_disk", contact_points=9)
    return plain_study(model, bd.Excitation("tip"), engine_order=5, friction_coefficient=0.4)


@pytest.fixture(scope="module")
def bonded(study):
    return study.replace(friction_law="bonded").optimal_curve(
        (20.0, 1e4), 3, frequency=INTERVAL, check=False
    )


@pytest.fixture(scope="module")
def curve(study):
    return study.frequency_response(8000.0, (345.0, 365.0))


@pytest.fixture(scope="module")
def rich(study):
    return study.replace(harmonics=3)


@pytest.fixture(scope="module")
def peak(rich):
    return rich.peak(8000.0, INTERVAL)


class TestHighestAtTheEnd:
    def test_is_not_called_a_peak(self, study):
        """At 2000 N the resonance is near 352 Hz: above 360 Hz the response falls."""
        curve = study.frequency_response(2000.0, (360.0, 380.0))
        assert curve.peak_at_end
        told = {fact.name: fact.to_digits(6) for fact in curve._facts()}
        assert told["peak status"] == "incomplete: highest at an end of the interval"
        assert (told["peak amplitude"], told["peak frequency"]) == ("223.667 µm", "360 Hz")
        assert curve.summary().startswith("No peak; highest point 224 µm at 360 Hz, at the lower")

    def test_a_maximum_is_a_peak(self, study):
        curve = study.frequency_response(2000.0, (330.0, 365.0))
        assert not curve.peak_at_end
        told = {fact.name: fact.to_digits(6) for fact in curve._facts()}
        assert told["peak status"] == "complete" and told["peak amplitude"] == amount(
            curve.peak.amplitude, "m", 6
        )

    def test_of_linear_limits(self, study):
        assert not study.free(INTERVAL).peak_at_end
        assert study.free((300.0, 380.0)).peak_at_end
        assert str(study.free((300.0, 380.0))).startswith("No peak; highest point")


class TestOptimum:
    def test_at_the_end_of_the_range(self, study):
        curve = study.optimal_curve((3e3, 2e4), 3, frequency=INTERVAL, check=False)
        assert curve.optimum.kind == "end"
        expected = "at the lower end of the range, 3 kN; a lower amplitude may lie below it"
        assert expected in said(curve)

    def test_without_any_peak_the_end_of_the_interval_is_named(self, study):
        curve = study.optimal_curve((100.0, 1e3), 3, frequency=(100.0, 150.0), check=False)
        assert (
            set(curve.kind) == {""}
            and np.isnan(curve.amplitude).all()
            and (curve.lower_bound > 0.0).all()
        )
        assert "highest at an end of the interval, without a maximum in it" in curve.summary()

    def test_without_any_response_is_refused(self, study, monkeypatch):
        def overflows(*args, **_):
            raise FloatingPointError("overflow")

        monkeypatch.setattr(
            sys.modules["bdamper.response.highest_peak"], "frequency_response", overflows
        )
        with pytest.raises(
            bd.BdamperError,
            match=r"no peak found at any of 3 preloads from 100 to 1000 N between 100 and",
        ):
            study.optimal_curve((100.0, 1e3), 3, frequency=(100.0, 150.0), check=False)

    def test_flat_where_the_preload_does_not_matter(self, bonded):
        assert bonded.optimum.kind == "flat"
        assert np.isnan(bonded.optimum.preload)
        assert bonded.optimum.amplitude == pytest.approx(bonded.stuck.amplitude, rel=1e-6)
        none = "none, the preload has no effect, not found: the preload does not matter"
        assert (
            Fact("optimum", none) in bonded._facts()
            and "The preload does not matter" in bonded.summary()
        )

    def test_flat_is_kept_in_a_file(self, bonded, tmp_path):
        bonded.save(tmp_path / "flat.h5")
        assert str(bd.load(tmp_path / "flat.h5")) == str(bonded)


class TestShortTexts:
    def test_of_objects_with_arrays(self, study):
        state = study.static(500.0)
        for item in (study.model, study, study.problem.coupling, state, study.model.bodies, study.model.interfaces,
                     study.settings, study.problem.bases[0], study.static(500.0), study.model.meshes,
                     study.frequency_response(2000.0, (360.0, 380.0))):  # fmt: skip
            assert len(str(item)) < 1500, type(item)
            assert len(repr(item)) < 1500, type(item)
            assert "array(" not in repr(item) and "\n" not in repr(item)

    def test_of_settings_that_are_arrays(self, study):
        faces = study.model.interfaces
        full = study.replace(
            contact_stiffness={name: np.full((face.n_points, 3), 1e7) for name, face in faces.items()},
            gap={name: np.full(face.n_points, 2e-6) for name, face in faces.items()}, bias=False,
        )  # fmt: skip
        text = str(full)
        assert "array" not in text
        assert re.search("bias +False", text) and re.search("gap +\\S", text)


class TestBottomLine:
    """What is printed begins with what a designer can act on."""

    @pytest.mark.slow
    def test_of_an_optimal_curve(self, study):
        curve = study.optimal_curve((200.0, 5e3), 6, frequency=INTERVAL, check=False)
        curve = replace(curve, model_doubts=())  # tests/harmonic_balance/test_rolling.py
        o, text = curve.optimum, said(curve)
        low, high = curve.preloads_within(NEAR_BEST * o.amplitude)
        assert low == 200.0, "the beginning of the search, which is no limit"
        preload, size = amount(o.preload, "N"), amount(o.amplitude, "m")
        ratio = f"{curve.free.amplitude / o.amplitude:.3g}"
        beginning = (
            f"Lowest amplitude at {preload}, {size} by harmonic balance alone, 2 checks uncertain: engine "
            "order 5, 1 N of excitation, friction coefficient 0.4 "
            f"Preload {preload} up to {amount(high, 'N')}, searched from {amount(low, 'N')}: "
            "at most 20 % above the lowest amplitude, "
            f"by harmonic balance Harmonic balance {size} {amount(o.frequency, 'Hz')}; "
            f"{error_text(curve.errors_at(o.preload))}; do not use this amplitude for stresses "
            f"Without contact {amount(curve.free.amplitude, 'm')} {ratio} times the lowest amplitude "
        )
        assert text.startswith(beginning)
        assert (
            "Not covered time integration, more blade modes, mistuning, wear, more contact points, "
            "friction coefficients other than 0.4 Next "
        ) in text
        assert low == 200.0, "the first preload: the amplitude has not risen there"
        assert "steeper" not in text
        shares = o.preload * np.array([0.5, 0.8, 0.9, 1.0, 1.2, 2.0])
        below = "; steeper below than above"
        above = "; steeper above than below"
        for ends, side in (((1.5, 1.6), ""), ((9.0, 1.6), below), ((1.5, 9.0), above)):
            values = o.amplitude * np.array([ends[0], 1.1, 1.0, 1.0, 1.1, ends[1]])
            unknown = np.full(6, np.nan)
            steep = replace(
                curve,
                preload=shares,
                requested=np.ones(6, bool),
                amplitude=values,
                lower_bound=unknown,
                curves=(),
                harmonic_change=None,
                vector_change=None,
            )
            bound = replace(
                steep,
                amplitude=np.where(values > 8.0 * o.amplitude, np.nan, values),
                lower_bound=values,
            )
            for c in (steep, bound):  # a lower bound counts as well
                remark = row(c, "Preload").remark
                assert remark.endswith(side) and ("steeper" in remark) == bool(side)
            # the amplitude of the flatter side is a lower bound and may rise faster than the other side
            doubtful = np.where(values == 1.6 * o.amplitude, np.nan, values)
            doubtful[[0, -1]] = np.where(
                values[[0, -1]] == 1.5 * o.amplitude, np.nan, doubtful[[0, -1]]
            )
            assert "steeper" not in said(replace(steep, amplitude=doubtful, lower_bound=values))
        at_twenty = {
            **curve.settings,
            "excitation": {**curve.settings["excitation"], "amplitude": 20.0},
        }
        text = said(replace(curve, settings=at_twenty))
        assert "20 N of excitation" in text
        load = study.at_speed(2.0 * np.pi * o.frequency / 5.0).preload
        assert (
            f" The damper has a centrifugal load of {amount(load, 'N')} at {amount(12.0 * o.frequency, 'rpm')}, "
            "where engine order 5 meets this resonance; the preload requires "
            f"{o.preload / load:.2g} times its mass "
        ) in text
        assert "times its mass" not in said(replace(curve, settings=at_twenty, mass_radius=np.nan))
        # the engine order of the study does not excite this resonance at twice the speed
        meets = 2.0 * np.pi * o.frequency / 5.0
        faster = said(replace(curve, settings=at_twenty | {"speed": 2.0 * meets}))
        assert "times its mass" not in faster
        assert (
            f" Engine order 5 meets this resonance at {amount(12.0 * o.frequency, 'rpm')}, not at "
            f"{amount(24.0 * o.frequency, 'rpm')}, the speed of the study"
        ) in faster
        near = said(replace(curve, settings=at_twenty | {"speed": 1.04 * meets}))
        assert (
            f" The damper has a centrifugal load of {amount(1.04**2 * load, 'N')} at "
            f"{amount(1.04 * 12.0 * o.frequency, 'rpm')}, the speed of the study"
        ) in near
        shares = at_twenty | {"load_per_preload": {"damper": 2.0}}  # the load is not the preload
        assert "times its mass" not in said(replace(curve, settings=shares))
        in_time = tuple(
            TimeResponse(0.9 * a, 0.8 * a, a, 1.0, p * o.preload, a)
            for p, a in ((1.0, 2.0), (1.35, 1.0))
        )
        more = replace(curve, time_response=in_time)
        assert value(more, "Preload") == amount(1.35 * o.preload, "N")
        assert (
            f"lowest by time integration; by harmonic balance {amount(o.preload, 'N')} "
            "higher preloads were not integrated"
        ) in said(more)
        assert row(more, "Design amplitude")[1:] == (
            "1 m",
            "largest of all checks, by time integration",
        )
        assert value(more, "Time integration") == "0.8 to 1 m"
        assert "Not covered time integration" not in said(more)
        lines = str(curve).split("\n")
        assert len(lines) <= 30 and max(map(len, lines)) <= 88
        assert lines[-1].strip() == "all values: curve.summary()"
        assert not any(line.startswith("Design amplitude") for line in lines), "not in time"
        flat = replace(
            curve,
            optimum=replace(o, preload=np.nan, kind="flat", status="not found", reason="flat"),
        )
        assert "does not matter" in flat._headline() and not flat.failures
        for stiffness, points, more in (
            ("model", None, False),
            ({"values": 1e7}, None, False),
            ({"values": 1e7}, 9, True),
        ):
            given = replace(
                curve,
                settings=curve.settings
                | {"contact_stiffness": stiffness, "contact_points": points},
            )
            assert ("more contact points" in said(given)) == more, (
                "contact points with given stiffnesses are joints"
            )

    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("change", "first"),
        [
            (
                {"kind": "end"},
                "the amplitude is lowest at the lower end of the range. Include preloads below",
            ),
            (
                {"status": "incomplete", "reason": "why"},
                "the search for the optimum is incomplete: why. Compute other preloads near",
            ),
            (
                1.3,
                "harmonic balance and time integration differ by 30 %. Add harmonics and blade modes until both",
            ),
            (
                np.nan,
                "time integration at 1 N is not found: why. Integrate at other preloads, study.",
            ),
            (
                [1.0, 1.3, 1.31],
                "more harmonics may be needed, 1.3 to 1.31 m with 5 to 7: not converged with 3. Use harmonics=5.",
            ),
        ],
    )
    def test_a_failed_check_comes_first(self, study, change, first):
        curve = study.optimal_curve((200.0, 5e3), 4, frequency=INTERVAL, check=False)
        curve = replace(curve, model_doubts=())
        o = replace(curve.optimum, kind="smooth", status="complete")
        if isinstance(change, dict):
            curve = replace(curve, optimum=replace(o, **change))
        elif isinstance(change, list):
            peaks = tuple(HarmonicPeak(h, a, 1.0) for h, a in zip((3, 5, 7), change))
            curve = replace(curve, optimum=o, convergence=Convergence(o.preload, 0.05, peaks))
        else:
            preload, *end = (
                (o.preload, "complete", "") if np.isfinite(change) else (1.0, "not found", "why")
            )
            status, reason = end
            response = TimeResponse(
                change, change, change, 1.0, preload, 1.0, status=status, reason=reason
            )
            curve = replace(curve, optimum=o, time_response=(response,))
        failure, _, remedy = first.partition(". ")
        printed = " ".join(str(curve).split())
        assert printed.startswith(f"Not for design: {failure}")
        assert f"Remedy: {remedy[:1].lower()}{remedy[1:].rstrip('.')}" in printed
        assert curve._headline().startswith(f"Not for design: {failure}")
        assert row(curve, "Preload").value
        assert np.isnan(curve.design_amplitude) and "esign amplitude" not in str(curve)

    @each(
        ("factors", "status", "colour"),
        [((1.1, 0.9), "complete", "green"), ((1.9, 1.0), "complete", "amber"), ((1.0, 1.1), "incomplete", "amber"),
         ((0.9, np.nan), "not found", "amber"), ((np.nan, 2.1), "incomplete", "red"),
         ((2.1, 0.5), "complete", "red")],
    )  # fmt: skip
    def test_other_friction(self, bonded, factors, status, colour):
        """Red where one of the amplitudes is more than twice as high, even if it is a lower bound."""
        o = replace(bonded.optimum, preload=1000.0, kind="smooth", status="complete")
        each_one = zip((1.0, 0.7, 1.3), (1.0, *factors), ("complete", "complete", status))
        peaks = [
            FrictionPeak(k, 1000.0, a, s, "" if s == "complete" else "why") for k, a, s in each_one
        ]
        curve = replace(bonded, optimum=o, other_friction=tuple(peaks))
        (check,) = [c for c in checks(curve) if c.name == "Other friction coefficients"]
        bound = "at least " if status == "incomplete" else ""
        heights = " and ".join("unknown" if np.isnan(a) else amount(a, "m") for a in factors[:1])
        heights += f" and {'unknown' if np.isnan(factors[1]) else bound + amount(factors[1], 'm')}"
        found = f"{heights} with 0.7 and 1.3 times the friction, by harmonic balance"
        assert (check.colour, check.found) == (colour, found)
        failure = f"Not for design: at 1 kN the amplitude is {found}"
        assert (failure in curve._headline()) == (colour == "red")
        remedy = "Remedy: choose a preload for these friction coefficients"
        assert (remedy in said(curve)) == (colour == "red")
        result = {"red": "FAIL", "amber": "uncertain", "green": "pass"}[colour]
        limit = (
            ""
            if colour == "green"
            else "; passes up to 1.2 times the amplitude, fails above 2 times"
        )
        what_to_do = f"; {check.remedy}" if colour == "amber" else ""
        printed = f"{found}{limit}{what_to_do}"
        assert printed_check(curve, check.name)[1:] == (result, printed)
        known = "1.3" if status == "complete" else "1"  # a peak that was not found is not covered
        assert f"friction coefficients outside 0.7 to {known} times 0.4" in said(curve)

    @pytest.mark.slow
    def test_friction_coefficients_of_points(self, study):
        points = {"left": np.array([0.0, 0.5, 0.2]), "right": 0.3}
        curve = study.optimal_curve((200.0, 5e3), 4, frequency=INTERVAL, check=False)
        text = said(replace(curve, settings=curve.settings | {"friction_coefficient": points}))
        assert "friction coefficients other than 0.2, 0.3, 0.5" in text

    def test_the_margin_is_that_near_the_preload(self, bonded):
        o = replace(bonded.optimum, preload=1000.0, kind="smooth", status="complete")
        margins = SimpleNamespace(
            preload=np.array([800.0, 1000.0, 2000.0]), margin=np.array([1.8, 0.8, 2.0])
        )
        (check,) = [
            c
            for c in checks(replace(bonded, optimum=o, margins=(margins,)))
            if c.name == "Fatigue safety factor"
        ]
        assert check.colour == "red" and check.found == "0.8 at 1 kN"

    def test_stiffening_that_the_model_neglects_is_not_covered_at_a_speed(self, bonded):
        o = replace(bonded.optimum, preload=1000.0, kind="smooth", status="complete")
        assert bonded.neglected == (), "this model has modes over the speed"
        curve = replace(bonded, optimum=o, neglected=("blade, nodal diameters 0, 5: modes of one",))
        stiffening = "centrifugal stiffening and spin softening (import the sector at two speeds)"
        # with an excitation of 1 N the print names no speed
        assert stiffening not in said(curve)
        at_speed = replace(curve, settings=curve.settings | {"speed": 400.0})
        assert stiffening in said(at_speed)
        assert stiffening not in said(replace(at_speed, neglected=()))
        # a load at the resonance of the model is one at a speed too
        ten_newtons = curve.settings["excitation"] | {"amplitude": 10.0}
        loaded = replace(curve, settings=curve.settings | {"excitation": ten_newtons})
        assert ("The damper has a centrifugal load" in said(loaded)) and stiffening in said(loaded)

    def test_the_calls_of_checks_and_remedies_run_as_printed(self, study, bonded, monkeypatch):
        """The names in the calls are those of their functions, and the limits those of the curve."""
        o = replace(bonded.optimum, preload=1000.0, kind="smooth", status="complete")
        peaks = tuple(FrictionPeak(k, 1000.0, a) for k, a in ((1.0, 1.0), (0.7, 2.1), (1.3, 0.5)))
        curve = replace(bonded, optimum=o)
        call = 'study.optimal_curve((20, 10000), 3, frequency=(270, 380), check="time")'
        assert call in said(curve)
        changed = checks(replace(curve, other_friction=peaks))
        (remedy,) = [check.remedy for check in changed if "Other friction" in check.name]
        _, _, robust = remedy.partition(": ")
        asked = []
        monkeypatch.setattr(bd, "robust_optimum", lambda *a, **k: asked.append((a, k)))
        eval(robust, {"bd": bd, "study": study})
        ((given, samples, limits), options) = asked[0]
        assert given is study and samples == {"friction_factor": [0.7, 1, 1.3]}
        assert limits[0] < 1000.0 < limits[1]
        assert options == {"percentile": 100, "frequency": (270, 380)}

    @pytest.mark.slow
    def test_an_uncertain_preload_is_named_in_all_places(self, study, tmp_path):
        """Print, check and warnings contain the same words."""
        curve = study.optimal_curve((200.0, 5e3), 4, frequency=INTERVAL, check=False)
        o = replace(curve.optimum, kind="jump", status="complete", uncertainty=0.24)
        uncertain = replace(curve, optimum=o)
        (check,) = [c for c in checks(uncertain) if c.name == "Search for the optimum"]
        assert (check.colour, check.found) == ("amber", "complete, preload uncertain by 24 %")
        assert ("", "", "preload uncertain by 24 %") in uncertain._statement().rows
        assert (
            o.text.endswith(", preload uncertain by 24 %")
            and Fact("optimum", o.text) in uncertain._facts()
        )
        lost = replace(curve, optimum=replace(o, status="incomplete", reason="why"))
        assert "optimum incomplete: why, preload uncertain by 24 %" in lost.warnings
        fine = replace(curve, optimum=replace(o, uncertainty=1e-6))
        assert "uncertain by" not in said(fine) and checks(fine)[1].colour == "green"

    def test_a_status_follows_the_amplitude_that_it_is_about(self):
        response = TimeResponse(
            9e-6, 8e-6, 1e-5, 300.0, 50.0, 2e-5, status="incomplete", reason="some steps failed"
        )
        text = said(response)
        assert text.startswith("Not for design: the time integration is incomplete: some steps f")
        assert (
            "Time integration 8 to 10 µm 300 Hz, mean 9 µm, range of all runs Harmonic balance 20 µm"
            in text
        )

    @pytest.mark.slow
    def test_harmonics_that_are_not_known_have_no_range(self, study):
        curve = study.optimal_curve((200.0, 5e3), 4, frequency=INTERVAL, check=False)
        first = HarmonicPeak(3, curve.optimum.amplitude, 1.0)
        alone = Convergence(
            curve.optimum.preload, 0.05, (first,), status="incomplete", reason="why"
        )
        text = said(replace(curve, convergence=alone))
        assert "3 to 3 harmonics" not in text
        assert "rely on the amplitude by time integration" in text


def test_details_have_the_units_of_the_columns(peak):
    assert (
        Fact("preload", 8000.0, "N") in peak._facts()
        and "\n  preload          8 kN\n" in peak.summary()
    )


def test_places_close_together_are_told_apart():
    assert (
        as_words({"preload": 1001.0}) == "preload 1.001 kN"
        and as_words({"mu": 0.46049}) == "mu 0.46049"
    )
    kept = TimeResponse(1e-4, 1e-4, 1e-4, 354.17, 4e3, 2e-4, jump_frequency=354.24, periods=9)
    assert "354.17 Hz, mean 100 µm, range of all runs" in said(kept)
    assert "Jump 354.24 Hz to a lower amplitude" in said(kept)


def test_attributes_that_are_not_there_are_answered(peak, curve):
    for result, name, answer in (
        (peak, "amplitudo", "Peak has no attribute 'amplitudo'; did you mean amplitude?"),
        (curve, "optimum", "ResponseCurve has no attribute 'optimum'; OptimalCurve has it"),
        (peak, "not_a_thing", "Peak has no attribute 'not_a_thing'"),
    ):
        with pytest.raises(AttributeError, match=re.escape(answer) + "$"):
            getattr(result, name)
    assert copy.deepcopy(peak).amplitude == peak.amplitude


def test_sensitivities_begin_with_the_largest(rich, peak):
    found = Sensitivities({"preload": PeakSensitivity("preload", 8e3, 1e-9, 2e-3, np.zeros(1)),
                           "friction_coefficient": PeakSensitivity("friction_coefficient", 0.4, -1e-3, 0.0, np.zeros(1)),
                           "gap_factor": PeakSensitivity("gap_factor", 1.0, np.nan, np.nan, np.zeros(1), "a corner")},
                          1e-3, 350.0)  # fmt: skip
    assert found._headline() == (
        "Friction coefficient has the largest effect: -0.4 % for +1 %, peak 1 mm at 350 Hz"
    )
    rows = [line.split("  ") for line in found.summary().splitlines()]
    names = [row[0] for row in rows]
    places = [names.index(n) for n in ("friction coefficient", "preload", "gap factor")]
    assert places == sorted(places)
    assert {"-0.4 %", "+0.008 %", "+0.046 %"} <= {cell.strip() for row in rows for cell in row}
    assert "Unknown: gap factor: a corner" in found.summary()
    assert rich.peak_sensitivities(peak, ("preload",)).changes().keys() == {"preload"}


def test_wide_tables_keep_every_column():
    """Many rows: further tables with the first column.  Few rows: the columns become rows."""
    head = ("name", *(f"column {k}" for k in range(12)), "empty")
    numbers = [f"1.23456{k}" for k in range(12)]
    rows = [head, *((f"row {i}", *numbers, "") for i in range(5))]
    lines = table_lines(rows, "  ")
    assert max(map(len, lines)) <= 120
    assert len(lines) == 12 and [line.split()[0] for line in lines[::6]] == ["name", "name"]
    for text in (*head[:-1], *numbers):
        assert text in "\n".join(lines)
    assert "empty" not in "".join(lines)
    turned = table_lines(rows[:3])
    assert [line.split()[-1] for line in turned] == ["1", *numbers]
    assert [line.split("  ")[0] for line in turned] == list(head[:-1])
    assert table_lines([("a", "b"), ("1", "2")]) == ["a  b", "1  2"] and not table_lines([])


def test_the_help_of_a_study_has_types_without_their_checks():
    shown = str(inspect.signature(bd.Study))
    assert "engine_order: 'int | None' = None" in shown and "damper_drag: 'float | " in shown
    assert "validation" not in shown and "Annotated" not in shown and "partial" not in shown
    (example,) = doctest.DocTestFinder(recurse=False).find(bd.Study, "Study")
    assert len(example.examples) == 4 and not doctest.DocTestRunner().run(example).failed


def test_every_result_that_prints_itself_is_shown_in_notebooks():
    printing = (
        WeibullTail,
        BestPreload,
        WedgeFriction,
        RobustOptimum,
        FEBody,
        DamperVariation,
        BladedDisk,
    )
    assert all("_repr_html_" in dir(kind) for kind in (*printing, MeasuredResponse))
    assert DamperVariation.of(6)._repr_html_().startswith("<div><p><b>6 dampers, none missing</b>")


def test_every_result_prints_a_statement():
    """Studies and models, which are not results, list their settings and parts."""
    for module in pkgutil.walk_packages(bd.__path__, "bdamper."):
        # pictures need optional packages and define no results
        if not module.name.startswith(("bdamper.plot", "bdamper.__main__")):
            importlib.import_module(module.name)
    kinds = [kind for kind in _kinds(Summarised) if kind.__module__.startswith("bdamper.")]
    printing = [kind for kind in kinds if kind.__module__ != display.__name__]
    without = {kind.__name__ for kind in printing if kind._statement is Summarised._statement}
    assert without == {"AllBlades", "Model", "Study"}
    assert not [
        kind
        for kind in printing
        if kind._statement is not Summarised._statement and "__str__" in vars(kind)
    ]


def test_the_repr_of_a_bladed_disk_is_one_line():
    disk = BladedDisk(lumped_study(), Mistuning.random(6, 0.02, seed=1))
    assert repr(disk) == "Bladed disk of 6 blades: 3 coordinates of each blade, 6 of each damper"
    assert str(disk).startswith(repr(disk))


def test_progress_is_on_outside_of_longer_work():
    calls = (bd.Study.frequency_response, bd.Study.optimal_curve, bd.Study.with_stability, bd.Study.motion_in_time,
             bd.Study.frequency_sweep, bd.Study.with_time_response, bd.Study.campbell, bd.Study.resonance_crossings,
             bd.Study.peak, bd.Study.time_response, bd.Study.effect_significance, bd.Study.harmonic_convergence,
             bd.Study.nonlinear_mode, bd.Study.flutter, bd.Study.run_up, BladedDisk.peak,
             bd.sweep, bd.compare, bd.robust_optimum, bd.optimal_curve_uncertainty, bd.mistuned_sample)  # fmt: skip
    assert {inspect.signature(call).parameters["progress"].default for call in calls} == {None}
    assert shows_progress(None) and shows_progress(True) and not shows_progress(False)
    with LongWork():
        assert not shows_progress(None)
    with pytest.raises(bd.SettingError, match=r"^progress: "):
        shows_progress(1)


def test_a_range_has_the_digits_before_the_decimal_point():
    assert span(3900.0, 4400.0, "Hz") == "3900 to 4400 Hz"
    assert span(1.5e-5, 1.234e-3, "m") == "0.015 to 1.23 mm"
