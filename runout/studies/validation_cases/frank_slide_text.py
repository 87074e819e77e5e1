"""Text of the page of the case Frank Slide."""

DIFFERENCES = """TO BE WRITTEN"""
