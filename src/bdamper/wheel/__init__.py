"""Whole wheels with blades and dampers that differ: mistuning, harmonic balance, samples of wheels and their statistics.

In: a problem whose model has a sector-local basis.  Out: curves and peaks of every blade, and statistics of many wheels.
"""

from bdamper.wheel.mistuning import DamperVariation as DamperVariation
from bdamper.wheel.mistuning import Mistuning as Mistuning
from bdamper.wheel.peak import WheelPeakOptions as WheelPeakOptions
from bdamper.wheel.results import WheelPeak as WheelPeak
from bdamper.wheel.sample import audit_wheels as audit_wheels
from bdamper.wheel.sample import mistuned_sample as mistuned_sample
from bdamper.wheel.sample_result import Audit as Audit
from bdamper.wheel.sample_result import BestPreload as BestPreload
from bdamper.wheel.sample_result import MistunedSample as MistunedSample
from bdamper.wheel.wheel import Wheel as Wheel
