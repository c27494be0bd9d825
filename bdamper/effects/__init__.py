"""Effects: which physical effects one scene calls for, and what the choice of the friction law changes.

In comes a problem with a preload and an interval of frequency.  ``advice.advise`` judges each effect, ``advice.apply``
makes the study with those called for, ``advice.check`` compares the two; ``compare_laws`` follows curves under several
friction laws, ``microslip`` the first loading of a seated damper; ``indicator`` estimates what another study changes of a
peak, ``richer.compare`` finds it.
"""
