"""Forced response of structures coupled through frictional contacts: bladed disks with free wedge dampers.

The names below are what a user starts with; types of results stand in the rooms that make them (docs/api.md lists all).
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bdamper.accuracy.ladders import accuracy_cost as accuracy_cost
    from bdamper.app.explorer import explore as explore
    from bdamper.contact.laws import Sampled as Sampled
    from bdamper.contact.own_law import ContactLaw as ContactLaw
    from bdamper.contact.residual_modes import ResidualModes as ResidualModes
    from bdamper.contact.stiffness import PerArea as PerArea
    from bdamper.continuation.path import ContinuationOptions as ContinuationOptions
    from bdamper.design.fit import fit as fit
    from bdamper.design.loop import fit_loop as fit_loop
    from bdamper.design.microslip import microslip as microslip
    from bdamper.design.residuals import Test as Test
    from bdamper.design.sweep import OptimalTask as OptimalTask
    from bdamper.design.sweep import PeakTask as PeakTask
    from bdamper.design.sweep import sweep as sweep
    from bdamper.design.uncertainty import draw as draw
    from bdamper.design.uncertainty import robust_optimum as robust_optimum
    from bdamper.design.uncertainty import uncertain_curve as uncertain_curve
    from bdamper.effects.comparison import compare as compare
    from bdamper.io import load_model as load_model
    from bdamper.io import save_model as save_model
    from bdamper.masses import Contact as Contact
    from bdamper.masses import lumped as lumped
    from bdamper.model.loads import Excitation as Excitation
    from bdamper.model.loads import Response as Response
    from bdamper.model.loads import influence_coefficients as influence_coefficients
    from bdamper.model.misfit import misfit as misfit
    from bdamper.model.model import Model as Model
    from bdamper.model.relative_motion import RIGID_NAMES as RIGID_NAMES
    from bdamper.peaks.newton import PeakOptions as PeakOptions
    from bdamper.problem.effects import Effects as Effects
    from bdamper.problem.settings import PAPER as PAPER
    from bdamper.shipped import reference_model as reference_model
    from bdamper.study import Study as Study
    from bdamper.study import load_study as load_study
    from bdamper.util.errors import BdamperError as BdamperError
    from bdamper.util.errors import ModelError as ModelError
    from bdamper.util.errors import SettingError as SettingError
    from bdamper.util.errors import StaticError as StaticError
    from bdamper.util.hdf5 import load as load
    from bdamper.util.warn import PlausibilityWarning as PlausibilityWarning
    from bdamper.wheel.sample import mistuned_sample as mistuned_sample
    from bdamper.wheel.wheel import Wheel as Wheel

    __version__: str

HOMES = {
    # a question
    "Study": "study",
    "Excitation": "model.loads",
    "Response": "model.loads",
    "Effects": "problem.effects",
    "influence_coefficients": "model.loads",
    "RIGID_NAMES": "model.relative_motion",
    "PAPER": "problem.settings",
    # how it is answered
    "Sampled": "contact.laws",
    "ContactLaw": "contact.own_law",
    "PerArea": "contact.stiffness",
    "ResidualModes": "contact.residual_modes",
    "ContinuationOptions": "continuation.path",
    "PeakOptions": "peaks.newton",
    # the structure
    "Model": "model.model",
    "reference_model": "shipped",
    "load_model": "io",
    "save_model": "io",
    "lumped": "masses",
    "Contact": "masses",
    "misfit": "model.misfit",
    # many variants of a question
    "compare": "effects.comparison",
    "sweep": "design.sweep",
    "PeakTask": "design.sweep",
    "OptimalTask": "design.sweep",
    "draw": "design.uncertainty",
    "uncertain_curve": "design.uncertainty",
    "robust_optimum": "design.uncertainty",
    # from measurements
    "Test": "design.residuals",
    "fit": "design.fit",
    "fit_loop": "design.loop",
    # whole wheels
    "Wheel": "wheel.wheel",
    "mistuned_sample": "wheel.sample",
    # what settings and contacts do
    "accuracy_cost": "accuracy.ladders",
    "microslip": "design.microslip",
    # results and studies from their files
    "load": "util.hdf5",
    "load_study": "study",
    # a page with sliders
    "explore": "app.explorer",
    # what a user can mend
    "BdamperError": "util.errors",
    "ModelError": "util.errors",
    "SettingError": "util.errors",
    "StaticError": "util.errors",
    # what it may want to look at
    "PlausibilityWarning": "util.warn",
}
"""Modules of the public names; each is imported when its name is first used."""

__all__ = list(HOMES)


def __dir__() -> list[str]:
    """Public names."""
    return sorted(__all__)


def __getattr__(name: str) -> Any:
    """A public name, or a room of the package."""
    if name == "__version__":
        return import_module("bdamper.util.versions").HERE.bdamper
    if name == "load":  # reads results of all rooms
        for home in HOMES.values():
            import_module(f"bdamper.{home}")
    if name in HOMES:
        return globals().setdefault(name, getattr(import_module(f"bdamper.{HOMES[name]}"), name))
    if not name.startswith("_"):  # tools ask for these; an editable install takes 0.1 s to search for a module
        try:
            return import_module(f"bdamper.{name}")
        except ModuleNotFoundError as error:
            if not f"bdamper.{name}".startswith(str(error.name)):
                raise
    raise AttributeError(f"module 'bdamper' has no attribute {name!r}")
