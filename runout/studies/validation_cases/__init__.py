"""Cases of the validation: runs beside published tools, experiments and observed events."""
