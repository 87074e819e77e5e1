"""What is known of a run before it starts: its grid and numerical error, its stiffness, its memory, its time."""
