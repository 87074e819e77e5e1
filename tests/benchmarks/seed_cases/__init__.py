"""Benchmarks of the published sparse material point method at full size: our numbers beside the published ones."""
