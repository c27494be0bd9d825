"""Forced response of structures coupled through frictional contacts: bladed disks with free wedge dampers."""

from bdamper.accuracy import AccuracyCost, Setting, accuracy_cost, load_accuracy
from bdamper.adaptive import AdaptivePeak
from bdamper.advice import Advice, load_advice
from bdamper.continuation import ContinuationOptions
from bdamper.coupling import RIGID_NAMES
from bdamper.effects import Effects
from bdamper.errors import BdamperError, ModelError, SettingError
from bdamper.estimates import ErrorEstimates, SourceError
from bdamper.excitation import Excitation, Response
from bdamper.io import load_model, save_model
from bdamper.laws import LawComparison
from bdamper.microslip import Microslip, microslip
from bdamper.misfit import misfit
from bdamper.model import Model
from bdamper.optimal import OptimalCurve, load_optimal_curve
from bdamper.peaks import Peak, PeakOptions
from bdamper.preload import PreloadState
from bdamper.prescribed import prescribe_preload
from bdamper.reference import reference_model
from bdamper.residual import ResidualModes
from bdamper.response import Curve, Fold, load_curve
from bdamper.seating import ContactMap, WedgeFriction, load_contact_map
from bdamper.settling import SettledResponse
from bdamper.stiffness import PerArea
from bdamper.study import Study
from bdamper.sweep import OptimalTask, PeakTask, SweepResult, load_sweep, sweep
from bdamper.system import Cost, Sampled
from bdamper.timedomain import Verification
from bdamper.uncertainty import (
    RobustOptimum,
    UncertainCurve,
    draw,
    load_uncertain_curve,
    robust_optimum,
    uncertain_curve,
)

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
