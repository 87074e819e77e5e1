"""Text of the page of the case Frank Slide."""

DIFFERENCES = """\
- **The mass moves alike.** Centroids differ by 1.5 cells at most. Energies agree until the mass comes to rest.
- **At 20 s and 15 deg the front lags by 170 m and the rear is 130 m ahead: the mass is shorter, not slower.** Finer cells do not
  change it. Less internal friction does. SHALTOP has hydrostatic pressure, which stretches the mass; 34 deg of internal
  friction resist that. With 16 deg, the least that passes on 15 deg at the base, half of the lag at 20 s and all of it at
  30 s is gone, and the CSI rises.
- **60 m of the lag arise in the first 10 s, with any internal friction and any cells.** The pile is up to 183 m thick and steep
  there. In SHALTOP its full weight drives it at once, whatever its vertical acceleration. In three dimensions the mass
  has to fall first.
- No parameter was fitted to SHALTOP: 34 deg is the value of `sites/frank_slide`.
- SHALTOP is a model, not an observation. The outline of the true deposit does not come with these data."""
