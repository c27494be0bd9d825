"""Resonance peaks: finding one, its sensitivities, following it over a parameter, all of them over the preload."""
