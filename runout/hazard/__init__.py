"""Hazard maps of an ensemble: exceedance probabilities, percentiles, and the products for a GIS."""
