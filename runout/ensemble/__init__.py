"""Ensemble of scenarios: a table of members, run over a local cluster, resumable, one bad member ends nothing."""
