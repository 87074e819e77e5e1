"""Where a slope may fail: drainage and sinks, infinite slope, release polygons, scarps, and a cheap baseline of the runout."""
