"""What all backends agree on: frozen dataclasses over NumPy, no loops."""
