"""Studies, one a file: each can be imported, is run by a command of ``runout`` and, coarse, by the tests."""
