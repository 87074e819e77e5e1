"""Material laws, one file each: parameters, return mapping, state. :mod:`runout.model.laws` finds them by their file names."""
