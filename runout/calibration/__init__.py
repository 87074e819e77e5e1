"""Which sampled parameters matter, and which of their values agree with an observed event, by emulators of the members."""
