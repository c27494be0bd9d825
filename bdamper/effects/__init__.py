"""Physical effects that a simulation includes: what each of them changes and what it costs."""
