"""Scores by what they are made of. Each file adds its ``SCORES``; no other file lists them."""
