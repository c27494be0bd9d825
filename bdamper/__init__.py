"""Forced response of structures coupled through frictional contacts: bladed disks with free wedge dampers.

The names below are what a user starts with; types of results stand in the rooms that make them (docs/api.md lists all).
"""

from bdamper.accuracy.ladders import accuracy_cost
from bdamper.contact.laws import Sampled
from bdamper.contact.residual_modes import ResidualModes
from bdamper.contact.stiffness import PerArea
from bdamper.continuation.path import ContinuationOptions
from bdamper.design.sweep import OptimalTask, PeakTask, sweep
from bdamper.design.uncertainty import draw, robust_optimum, uncertain_curve
from bdamper.effects.microslip import microslip
from bdamper.io import load_model, save_model
from bdamper.io.from_fe import from_fe
from bdamper.io.model_file import reference_model
from bdamper.masses import Contact, lumped
from bdamper.model.coupling import RIGID_NAMES
from bdamper.model.loads import Excitation, Response
from bdamper.model.misfit import misfit
from bdamper.model.model import Model
from bdamper.peaks.newton import PeakOptions
from bdamper.problem.effects import Effects
from bdamper.problem.prescribed import prescribe_preload
from bdamper.problem.settings import PAPER
from bdamper.study import Study
from bdamper.util.errors import BdamperError, ModelError, SettingError, StaticError
from bdamper.util.hdf5 import load
from bdamper.util.versions import HERE
from bdamper.util.warn import PlausibilityWarning
from bdamper.wheel.sample import mistuned_sample
from bdamper.wheel.wheel import Wheel

__version__ = HERE.bdamper

__all__ = [  # noqa: RUF022
    # a question
    "Study",
    "Excitation",
    "Response",
    "Effects",
    "RIGID_NAMES",
    "PAPER",
    # how it is answered
    "Sampled",
    "PerArea",
    "ResidualModes",
    "ContinuationOptions",
    "PeakOptions",
    # the structure
    "Model",
    "reference_model",
    "load_model",
    "save_model",
    "from_fe",
    "lumped",
    "Contact",
    "prescribe_preload",
    "misfit",
    # many variants of a question
    "sweep",
    "PeakTask",
    "OptimalTask",
    "draw",
    "uncertain_curve",
    "robust_optimum",
    # whole wheels
    "Wheel",
    "mistuned_sample",
    # what settings and contacts do
    "accuracy_cost",
    "microslip",
    # results from their files
    "load",
    # what a user can mend
    "BdamperError",
    "ModelError",
    "SettingError",
    "StaticError",
    # what it may want to look at
    "PlausibilityWarning",
]

_SUCCESSORS = {
    "AdaptivePeak": "Study.advise and Study.apply",
    "AccuracyCost": "bdamper.accuracy.ladders.AccuracyCost",
    "Advice": "bdamper.effects.advice.Advice",
    "ContactMap": "bdamper.contact.wedge.ContactMap",
    "Cost": "bdamper.util.cost.Cost",
    "Curve": "bdamper.continuation.curve.Curve",
    "ErrorEstimates": "bdamper.util.estimates.ErrorEstimates",
    "Fold": "bdamper.continuation.curve.Fold",
    "LawComparison": "bdamper.effects.compare_laws.LawComparison",
    "Microslip": "bdamper.effects.microslip.Microslip",
    "OptimalCurve": "bdamper.peaks.optimal_curve.OptimalCurve",
    "Peak": "bdamper.peaks.newton.Peak",
    "PreloadState": "bdamper.contact.preload.PreloadState",
    "RobustOptimum": "bdamper.design.uncertainty.RobustOptimum",
    "Setting": "a mapping of names to settings in accuracy_cost(vary={...})",
    "SettledResponse": "bdamper.stability.steady_state.SettledResponse",
    "SourceError": "bdamper.util.estimates.SourceError",
    "SweepResult": "bdamper.design.sweep.SweepResult",
    "UncertainCurve": "bdamper.design.uncertainty.UncertainCurve",
    "Verification": "bdamper.stability.verification.Verification",
    "WedgeFriction": "bdamper.contact.wedge.WedgeFriction",
    "load_accuracy": "bdamper.load",
    "load_advice": "bdamper.load",
    "load_contact_map": "bdamper.load",
    "load_curve": "bdamper.load",
    "load_optimal_curve": "bdamper.load",
    "load_sweep": "bdamper.load",
    "load_uncertain_curve": "bdamper.load",
}
"""Public names of version 0.1 and what stands for them."""


def __getattr__(name: str) -> object:
    if name in _SUCCESSORS:
        raise AttributeError(f"bdamper.{name} has gone with version 0.2: use {_SUCCESSORS[name]}")
    raise AttributeError(f"module 'bdamper' has no attribute '{name}'")
