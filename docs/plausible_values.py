"""Start of the kernels that run the notebooks: the manual teaches no value of which the program warns."""

import warnings

from bdamper import PlausibilityWarning

warnings.simplefilter("error", PlausibilityWarning)
