"""Studies of the method: verification, stability, run time against error."""
