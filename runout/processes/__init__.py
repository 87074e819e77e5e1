"""The processes of a command: signals, child processes, cache folders."""
