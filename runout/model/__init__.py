"""The model that all backends share: frozen dataclasses with NumPy arrays."""
