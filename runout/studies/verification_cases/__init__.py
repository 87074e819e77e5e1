"""Cases of verification, one subject per file: set-up, reference solution, and bounds."""
