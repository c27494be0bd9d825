"""Forced response of structures coupled through frictional contacts: bladed disks with free wedge dampers.

The names below are what a user starts with; types of results stand in the rooms that make them (docs/api.md lists all).
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bdamper.analyses.accuracy import accuracy_cost as accuracy_cost
    from bdamper.analyses.fit import fit as fit
    from bdamper.analyses.hysteresis import microslip as microslip
    from bdamper.analyses.loop_fit import fit_loop as fit_loop
    from bdamper.analyses.response_residuals import MeasuredResponse as MeasuredResponse
    from bdamper.analyses.robust_optimum import optimal_curve_uncertainty as optimal_curve_uncertainty
    from bdamper.analyses.robust_optimum import robust_optimum as robust_optimum
    from bdamper.analyses.robust_optimum import sample as sample
    from bdamper.analyses.sweep import OptimalTask as OptimalTask
    from bdamper.analyses.sweep import PeakTask as PeakTask
    from bdamper.analyses.sweep import compare as compare
    from bdamper.analyses.sweep import sweep as sweep
    from bdamper.contact.laws import AFT as AFT
    from bdamper.contact.laws import ContactLaw as ContactLaw
    from bdamper.contact.residual_flexibility import ResidualModes as ResidualModes
    from bdamper.contact.stiffness import PerArea as PerArea
    from bdamper.fem.reference_models import reference_model as reference_model
    from bdamper.harmonic_balance.effects import Effects as Effects
    from bdamper.harmonic_balance.settings import CIGEROGLU_2009 as CIGEROGLU_2009
    from bdamper.lumped_masses import Contact as Contact
    from bdamper.lumped_masses import lumped as lumped
    from bdamper.mistuning.sample import mistuned_sample as mistuned_sample
    from bdamper.mistuning.wheel import BladedDisk as BladedDisk
    from bdamper.model.contact_points import face_gap as face_gap
    from bdamper.model.kinematics import RIGID_NAMES as RIGID_NAMES
    from bdamper.model.loads import Excitation as Excitation
    from bdamper.model.loads import Response as Response
    from bdamper.model.loads import influence_coefficients as influence_coefficients
    from bdamper.model.model_file import load_model as load_model
    from bdamper.model.model_file import save_model as save_model
    from bdamper.model.structure import Model as Model
    from bdamper.plot.explorer import explore as explore
    from bdamper.response.events import ContinuationOptions as ContinuationOptions
    from bdamper.response.peak import PeakOptions as PeakOptions
    from bdamper.study import Study as Study
    from bdamper.study import load_study as load_study
    from bdamper.util.errors import BdamperError as BdamperError
    from bdamper.util.errors import ModelError as ModelError
    from bdamper.util.errors import PlausibilityWarning as PlausibilityWarning
    from bdamper.util.errors import SettingError as SettingError
    from bdamper.util.errors import StaticError as StaticError
    from bdamper.util.storage import load as load

    __version__: str

HOMES = {
    # a question
    "Study": "study",
    "Excitation": "model.loads",
    "Response": "model.loads",
    "Effects": "harmonic_balance.effects",
    "influence_coefficients": "model.loads",
    "RIGID_NAMES": "model.kinematics",
    "CIGEROGLU_2009": "harmonic_balance.settings",
    # how it is answered
    "AFT": "contact.laws",
    "ContactLaw": "contact.laws",
    "PerArea": "contact.stiffness",
    "ResidualModes": "contact.residual_flexibility",
    "ContinuationOptions": "response.events",
    "PeakOptions": "response.peak",
    # the structure
    "Model": "model.structure",
    "reference_model": "fem.reference_models",
    "load_model": "model.model_file",
    "save_model": "model.model_file",
    "lumped": "lumped_masses",
    "Contact": "lumped_masses",
    "face_gap": "model.contact_points",
    # many variants of a question
    "compare": "analyses.sweep",
    "sweep": "analyses.sweep",
    "PeakTask": "analyses.sweep",
    "OptimalTask": "analyses.sweep",
    "sample": "analyses.robust_optimum",
    "optimal_curve_uncertainty": "analyses.robust_optimum",
    "robust_optimum": "analyses.robust_optimum",
    # from measurements
    "MeasuredResponse": "analyses.response_residuals",
    "fit": "analyses.fit",
    "fit_loop": "analyses.loop_fit",
    # whole wheels
    "BladedDisk": "mistuning.wheel",
    "mistuned_sample": "mistuning.sample",
    # what settings and contacts do
    "accuracy_cost": "analyses.accuracy",
    "microslip": "analyses.hysteresis",
    # results and studies from their files
    "load": "util.storage",
    "load_study": "study",
    # a page with sliders
    "explore": "plot.explorer",
    # what a user can mend
    "BdamperError": "util.errors",
    "ModelError": "util.errors",
    "SettingError": "util.errors",
    "StaticError": "util.errors",
    # what it may want to look at
    "PlausibilityWarning": "util.errors",
}
"""Modules of the public names; each is imported when its name is first used."""

__all__ = list(HOMES)


def __dir__() -> list[str]:
    """Public names."""
    return sorted(__all__)


def __getattr__(name: str) -> Any:
    """A public name, or a room of the package."""
    if name == "__version__":
        return import_module("bdamper.util.storage").INSTALLED.bdamper
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
