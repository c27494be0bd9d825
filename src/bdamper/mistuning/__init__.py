"""Mistuned bladed disks: harmonic balance of all sectors, random samples and their statistics.

`BladedDisk` solves a problem whose model has a sector-local basis, for one `Mistuning` and one `DamperVariation`.
`mistuned_sample` solves many random bladed disks and fits the distribution of the highest blade amplitude.
"""

from bdamper.mistuning.mistuning import DamperVariation as DamperVariation
from bdamper.mistuning.mistuning import Mistuning as Mistuning
from bdamper.mistuning.peak import WheelPeak as WheelPeak
from bdamper.mistuning.peak import WheelPeakOptions as WheelPeakOptions
from bdamper.mistuning.sample import Audit as Audit
from bdamper.mistuning.sample import BestPreload as BestPreload
from bdamper.mistuning.sample import MistunedSample as MistunedSample
from bdamper.mistuning.sample import audit_wheels as audit_wheels
from bdamper.mistuning.sample import mistuned_sample as mistuned_sample
from bdamper.mistuning.wheel import BladedDisk as BladedDisk
