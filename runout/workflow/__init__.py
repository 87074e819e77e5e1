"""The workflow of a site: check, plan, run of the stages, status."""
