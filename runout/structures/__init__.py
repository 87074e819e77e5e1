"""Structures: footprints and meshes -> closed bodies with named facades, their signed distance, and patches for forces."""
