"""Forced response of structures coupled through frictional contacts: bladed disks with free wedge dampers.

The names below are what a user starts with; types of results stand in the rooms that make them (docs/api.md lists all).
"""

from bdamper.accuracy.ladders import accuracy_cost
from bdamper.app.explorer import explore
from bdamper.contact.laws import Sampled
from bdamper.contact.residual_modes import ResidualModes
from bdamper.contact.stiffness import PerArea
from bdamper.continuation.path import ContinuationOptions
from bdamper.design.sweep import OptimalTask, PeakTask, sweep
from bdamper.design.uncertainty import draw, robust_optimum, uncertain_curve
from bdamper.effects.microslip import microslip
from bdamper.io import load_model, save_model
from bdamper.io.from_fe import from_fe
from bdamper.masses import Contact, lumped
from bdamper.model.coupling import RIGID_NAMES
from bdamper.model.loads import Excitation, Response
from bdamper.model.misfit import misfit
from bdamper.model.model import Model
from bdamper.peaks.newton import PeakOptions
from bdamper.problem.effects import Effects
from bdamper.problem.prescribed import prescribe_preload
from bdamper.problem.settings import PAPER
from bdamper.shipped import reference_model
from bdamper.study import Study, load_study
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
    # results and studies from their files
    "load",
    "load_study",
    # a page with sliders
    "explore",
    # what a user can mend
    "BdamperError",
    "ModelError",
    "SettingError",
    "StaticError",
    # what it may want to look at
    "PlausibilityWarning",
]
