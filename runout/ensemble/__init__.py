"""Ensemble of scenarios: a table of members, run by local worker processes. Runs can be resumed; failed members do not end them."""
