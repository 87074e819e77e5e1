"""Which sampled parameters matter, and which of their values agree with an observed event: emulators of members, not more members."""
