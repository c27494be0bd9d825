"""Mistuned bladed disks: harmonic balance of all sectors, random samples and their statistics.

`BladedDisk` solves a problem whose model has a sector-local basis, for one `Mistuning` and one
`DamperVariation`. `mistuned_sample` solves many random bladed disks and fits the distribution of
the largest blade amplitude.
"""

from bdamper.mistuning.bladed_disk import BladedDisk as BladedDisk
from bdamper.mistuning.mistuning import DamperVariation as DamperVariation
from bdamper.mistuning.mistuning import Mistuning as Mistuning
from bdamper.mistuning.peak import DiskPeak as DiskPeak
from bdamper.mistuning.peak import DiskPeakOptions as DiskPeakOptions
from bdamper.mistuning.sample import Audit as Audit
from bdamper.mistuning.sample import BestPreload as BestPreload
from bdamper.mistuning.sample import MistunedSample as MistunedSample
from bdamper.mistuning.sample import audit_disks as audit_disks
from bdamper.mistuning.sample import mistuned_sample as mistuned_sample
