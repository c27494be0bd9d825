"""Public names of bdamper; ``__init__.py`` imports each one when it is first used."""
# ruff: noqa: I001

# subpackages and modules
from . import analyses as analyses
from . import contact as contact
from . import fatigue as fatigue
from . import fem as fem
from . import harmonic_balance as harmonic_balance
from . import importers as importers
from . import lumped_masses as lumped_masses
from . import mistuning as mistuning
from . import model as model
from . import plot as plot
from . import response as response
from . import study as study
from . import time_domain as time_domain
from . import util as util

# problem
from .study import Study as Study
from .model.loads import Excitation as Excitation
from .model.loads import Response as Response
from .harmonic_balance.effects import Effects as Effects
from .model.loads import influence_coefficients as influence_coefficients
from .model.kinematics import RIGID_NAMES as RIGID_NAMES
from .harmonic_balance.settings import CIGEROGLU_2009 as CIGEROGLU_2009

# methods and options
from .contact.laws import AFT as AFT
from .contact.laws import ContactLaw as ContactLaw
from .contact.stiffness import PerArea as PerArea
from .contact.residual_flexibility import ResidualModes as ResidualModes
from .response.events import ContinuationOptions as ContinuationOptions
from .response.peak import PeakOptions as PeakOptions

# models
from .model.structure import Model as Model
from .fem.reference_models import reference_model as reference_model
from .model.model_file import load_model as load_model
from .model.model_file import save_model as save_model
from .lumped_masses import joint as joint
from .lumped_masses import lumped as lumped
from .lumped_masses import Contact as Contact
from .model.contact_points import face_gap as face_gap

# parameter studies
from .analyses.sweep import compare as compare
from .analyses.sweep import sweep as sweep
from .analyses.sweep import PeakTask as PeakTask
from .analyses.sweep import OptimalTask as OptimalTask
from .analyses.robust_optimum import sample as sample
from .analyses.robust_optimum import optimal_curve_uncertainty as optimal_curve_uncertainty
from .analyses.robust_optimum import robust_optimum as robust_optimum

# fits to measurements
from .analyses.response_residuals import MeasuredResponse as MeasuredResponse
from .analyses.fit import fit as fit
from .analyses.loop_fit import fit_loop as fit_loop

# mistuned bladed disks
from .mistuning.bladed_disk import BladedDisk as BladedDisk
from .mistuning.sample import mistuned_sample as mistuned_sample

# accuracy and contact behaviour
from .analyses.accuracy import accuracy_cost as accuracy_cost
from .analyses.hysteresis import microslip as microslip

# cores
from .util.workers import set_workers as set_workers

# files
from .util.storage import load as load
from .study import load_study as load_study

# explorer
from .plot.explorer import explore as explore

# errors
from .util.errors import BdamperError as BdamperError
from .util.errors import ModelError as ModelError
from .util.errors import SettingError as SettingError
from .util.errors import StaticError as StaticError

# warnings
from .util.errors import PlausibilityWarning as PlausibilityWarning

__version__: str
