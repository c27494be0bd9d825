"""Forced response of structures coupled through frictional contacts: bladed disks with free wedge dampers."""

from bdamper.accuracy.ladders import AccuracyCost, Setting, accuracy_cost
from bdamper.contact.laws import Sampled
from bdamper.contact.residual_modes import ResidualModes
from bdamper.contact.static import PreloadState
from bdamper.contact.stiffness import PerArea
from bdamper.contact.wedge import ContactMap, WedgeFriction
from bdamper.continuation.curve import Curve, Fold
from bdamper.continuation.follower import ContinuationOptions
from bdamper.design.sweep import OptimalTask, PeakTask, SweepResult, sweep
from bdamper.design.uncertainty import (
    RobustOptimum,
    UncertainCurve,
    draw,
    robust_optimum,
    uncertain_curve,
)
from bdamper.effects.advice import Advice
from bdamper.effects.compare_laws import LawComparison
from bdamper.effects.microslip import Microslip, microslip
from bdamper.io import load_model, save_model
from bdamper.io.model_file import reference_model
from bdamper.model.coupling import RIGID_NAMES
from bdamper.model.loads import Excitation, Response
from bdamper.model.misfit import misfit
from bdamper.model.model import Model
from bdamper.peaks.newton import Peak, PeakOptions
from bdamper.peaks.optimal_curve import OptimalCurve
from bdamper.problem.effects import Effects
from bdamper.problem.prescribed import prescribe_preload
from bdamper.stability.steady_state import SettledResponse
from bdamper.stability.time_integration import Verification
from bdamper.study import Study
from bdamper.util.cost import Cost
from bdamper.util.errors import BdamperError, ModelError, SettingError
from bdamper.util.estimates import ErrorEstimates, SourceError
from bdamper.util.hdf5 import load

__version__ = "0.1.0"

__all__ = [
    "RIGID_NAMES",
    "AccuracyCost",
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
    "load",
    "load_model",
    "microslip",
    "misfit",
    "prescribe_preload",
    "reference_model",
    "robust_optimum",
    "save_model",
    "sweep",
    "uncertain_curve",
]
