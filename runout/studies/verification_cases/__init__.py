"""Cases of verification, one subject a file: the set-up, what it is compared with, and the bounds that it must keep."""
