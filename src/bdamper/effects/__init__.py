"""Effects: which physical effects one scene calls for, and what the choice of settings changes.

In comes a problem with a preload and an interval of frequency.  ``advice.advise`` determines each effect;
``comparison.compare`` asks several studies the same question; ``indicator`` estimates what another study changes of a peak,
``richer.compare`` finds it.
"""
