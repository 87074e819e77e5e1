"""Generated pages of the documentation: one file each, from the record of its study."""
