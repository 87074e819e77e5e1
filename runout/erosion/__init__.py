"""Laws of erosion, one file each: parameters and rate. :mod:`runout.model.erosion_laws` finds them by their file names."""
