"""Material laws, one file each: parameters, return mapping, state. :mod:`runout.model.laws` finds them here by themselves."""
