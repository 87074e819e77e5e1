"""Cases of the stability stress test: layouts, invariants and trials."""
