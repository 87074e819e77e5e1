"""Cases of the stability stress test: what is run, what must hold, what was tried."""
