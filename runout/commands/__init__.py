"""Commands by subject; each parses its arguments and delegates."""
