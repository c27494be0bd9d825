"""Forced response of structures coupled through frictional contacts: bladed disks with free wedge dampers."""

from bdamper.accuracy.ladders import AccuracyCost, Setting, accuracy_cost, load_accuracy
from bdamper.contact.laws import Sampled
from bdamper.contact.residual_modes import ResidualModes
from bdamper.contact.static import PreloadState
from bdamper.contact.stiffness import PerArea
from bdamper.contact.wedge import ContactMap, WedgeFriction, load_contact_map
from bdamper.continuation.curve import Curve, Fold, load_curve
from bdamper.continuation.follower import ContinuationOptions
from bdamper.design.sweep import OptimalTask, PeakTask, SweepResult, load_sweep, sweep
from bdamper.design.uncertainty import (
    RobustOptimum,
    UncertainCurve,
    draw,
    load_uncertain_curve,
    robust_optimum,
    uncertain_curve,
)
from bdamper.effects.adaptive import AdaptivePeak
from bdamper.effects.advice import Advice, load_advice
from bdamper.effects.compare_laws import LawComparison
from bdamper.effects.microslip import Microslip, microslip
from bdamper.io import load_model, save_model
from bdamper.io.reference import reference_model
from bdamper.model.coupling import RIGID_NAMES
from bdamper.model.loads import Excitation, Response
from bdamper.model.misfit import misfit
from bdamper.model.model import Model
from bdamper.peaks.newton import Peak, PeakOptions
from bdamper.peaks.optimal import OptimalCurve, load_optimal_curve
from bdamper.problem.effects import Effects
from bdamper.problem.prescribed import prescribe_preload
from bdamper.stability.steady_state import SettledResponse
from bdamper.stability.time_integration import Verification
from bdamper.study import Study
from bdamper.util.cost import Cost
from bdamper.util.errors import BdamperError, ModelError, SettingError
from bdamper.util.estimates import ErrorEstimates, SourceError

__version__ = "0.1.0"

__all__ = [
    "RIGID_NAMES",
    "AccuracyCost",
    "AdaptivePeak",
    "Advice",
    "BdamperError",
    "ContactMap",
    "ContinuationOptions",
    "Cost",
    "Curve",
    "Effects",
    "ErrorEstimates",
    "Excitation",
    "Fold",
    "LawComparison",
    "Microslip",
    "Model",
    "ModelError",
    "OptimalCurve",
    "OptimalTask",
    "Peak",
    "PeakOptions",
    "PeakTask",
    "PerArea",
    "PreloadState",
    "ResidualModes",
    "Response",
    "RobustOptimum",
    "Sampled",
    "Setting",
    "SettingError",
    "SettledResponse",
    "SourceError",
    "Study",
    "SweepResult",
    "UncertainCurve",
    "Verification",
    "WedgeFriction",
    "accuracy_cost",
    "draw",
    "load_accuracy",
    "load_advice",
    "load_contact_map",
    "load_curve",
    "load_model",
    "load_optimal_curve",
    "load_sweep",
    "load_uncertain_curve",
    "microslip",
    "misfit",
    "prescribe_preload",
    "reference_model",
    "robust_optimum",
    "save_model",
    "sweep",
    "uncertain_curve",
]
