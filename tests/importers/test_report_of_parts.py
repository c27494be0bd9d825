"""Import check of the stiffness under partial contact."""

from types import SimpleNamespace

import pytest

from bdamper.contact.partial_contact import WHOLE, PartialContact
from bdamper.importers import build as module
from bdamper.importers.prepared_body import ImportReport
from bdamper.util.formatting import percent
from tests.annulus import small_sector
from tests.fe_bodies import SIX_BLADES, contacts
from tests.imports import build
from tests.printed import said

TEXT = "residual modes: the shift of mode 1 by bonded faces"
NO_MODEL = SimpleNamespace()


@pytest.fixture(scope="module")
def fe():
    return small_sector(6)


@pytest.mark.slow
def test_the_report_of_a_coarse_sector_names_the_error(bodies):
    """Two rows of elements on the faces: bonded faces and parts of them are stiffer than with all vectors."""
    given = SIX_BLADES | {"n_modes": 4, "contacts": contacts(9)}
    built = build(*bodies, **given, engine_order=[1], harmonics=1)
    (line,) = [line for line in (*built.checks, *built.missing) if TEXT in line]
    assert f"Not in this model: {line}" in said(built)
    assert line in built.missing and 'contact_stiffness=bd.ResidualModes("all")' in line


def report_of(monkeypatch, shift, whole, part, richer):
    """Report and choice of the check, with given errors of the vectors of bonded faces and of partial contact."""

    def found(coupling, options):
        error = richer if options.partial_contact else part
        errors = {WHOLE: whole, "inner third": error, "outer third": 0.01}
        return PartialContact((shift, 0.02), errors)

    monkeypatch.setattr(module, "coupling_of_default", lambda model, diameter: NO_MODEL)
    monkeypatch.setattr(module, "partial_contact", found)
    report = ImportReport()
    return report, module._needs_partial_contact(NO_MODEL, 5, report)


@pytest.mark.parametrize(
    ("shift", "whole", "part"),
    [(0.08, -0.049, 0.149), (0.08, 0.0, -0.149), (0.004, 0.3, 0.4)],
)
def test_errors_within_the_limits_and_dampers_without_effect_pass(monkeypatch, shift, whole, part):
    report, is_needed = report_of(monkeypatch, shift, whole, part, 0.0)
    assert TEXT in report.checks[1] and not report.missing and not is_needed
    hint = "; the damper has little effect below mode 2;" if shift == 0.004 else ""
    assert report.checks[0].startswith(
        "dampers: bonded faces raise the lowest 2 frequencies of nodal diameter 5 by "
        f"{percent(shift)}, 2 %{hint}"
    )


@pytest.mark.parametrize(
    ("shifts", "first"), [((0.002, 0.004, 0.1, 0.5), 3), ((0.1, 0.002), None), ((0.002,), None)]
)
def test_the_first_mode_that_a_damper_shifts_is_named(monkeypatch, shifts, first):
    """Peaks are those of mode 1 unless another is given."""
    found = PartialContact(shifts, {WHOLE: 0.0, "inner third": 0.0})
    monkeypatch.setattr(module, "coupling_of_default", lambda model, diameter: NO_MODEL)
    monkeypatch.setattr(module, "partial_contact", lambda coupling, options: found)
    report = ImportReport()
    module._needs_partial_contact(NO_MODEL, 5, report)
    hint = f"; the damper has little effect below mode {first}; select a mode with mode="
    assert (hint in report.checks[0]) == (first is not None)
    assert ("little effect" in report.checks[0]) == (first is not None)


def test_vectors_for_partial_contact_are_chosen_where_they_help(monkeypatch):
    report, is_needed = report_of(monkeypatch, 0.08, 0.0, -0.151, 0.02)
    assert is_needed and not report.missing
    assert report.checks[1] == (
        "residual modes for partial contact: the shift of mode 1 by bonded faces (8 %) agrees with all "
        "vectors within 0 %, for parts within 2 % (inner third); within 15 % with only the vectors of "
        "whole faces"
    )


@pytest.mark.parametrize(
    ("whole", "part", "richer", "chosen"), [(0.0, 0.4, 0.3, True), (0.051, 0.1, 0.4, False)]
)
def test_an_error_above_a_limit_names_the_setting_without_it(
    monkeypatch, whole, part, richer, chosen
):
    report, is_needed = report_of(monkeypatch, 0.08, whole, part, richer)
    assert is_needed == chosen and len(report.checks) == 1
    (line,) = report.missing
    assert "(inner third)" in line and 'contact_stiffness=bd.ResidualModes("all")' in line


def test_models_without_friction_faces_have_no_such_row(monkeypatch):
    monkeypatch.setattr(module, "coupling_of_default", lambda model, diameter: None)
    report = ImportReport()
    assert not module._needs_partial_contact(NO_MODEL, 5, report)
    assert not report.checks and not report.missing


@pytest.mark.slow
@pytest.mark.parametrize("needed", [True, False])
def test_the_imported_model_has_the_choice(bodies, monkeypatch, needed):
    monkeypatch.setattr(module, "_needs_partial_contact", lambda *given: needed)
    given = SIX_BLADES | {"n_modes": 4, "contacts": contacts(9)}
    built = build(*bodies, **given, engine_order=[1], harmonics=1)
    assert bool(built.model.partial_contact) == needed
