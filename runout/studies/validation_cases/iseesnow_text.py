"""Text of the pages of ISeeSnow."""

COULOMB_DIFFERENCES = """\
- **With 2 x 2 x 4 particles in cells of 5 m the area is below every tool. Reason: the slab is one particle thick.** Levels are a
  quarter of a cell; the slab of 1.8 m (vertical) is one of them. Its sides carry
  0.64 of the hydrostatic pressure (last column, 0.45 in cells of 10 m), so it spreads too little to its sides and stays too
  thick. No thin rim is lost below a threshold: the area above 0.001 m is too small as well, and that above 1 m is too large.
- **More levels in the same cells mend it**, and so do flat cells and small cells. Four levels at 5 m: pressure 0.88, +2 ha.
  So the default has four levels through releases thinner than half a cell, here 2 x 2 x 12. They take twice the time of one.
- The polygon has partly filled cells at its rim, which lowers the pressure there; compare the rows of the raster.
- With cells of 10 m the map smooths particles that are far apart, which hides a part of the deficit of one level.
- What is left to the median of the tools, 1 to 2 ha, is in the run-out zone. The tools have hydrostatic pressure; internal friction
  resists spreading (compare [Frank Slide](frank_slide.md), where this was measured).
- The front stops 75 m before the median, where RAMMS, com1DFA, samosAT and the MPM of the table stop (4160 to 4180 m). The tools'
  fronts spread over 660 m.
- Peak thickness in the track is above the median of the tools by up to 1 m, and below it where the track begins."""
TOPO_DIFFERENCES = """\
- **Internal friction decides whether the base can pass on the drag.** On 34 deg a steady Voellmy flow needs 0.675 of its
  load as shear, and a mass of internal friction phi passes on sin(phi) at most. With 30 deg the mass shears over a slow base
  once the cells resolve it; with 40 deg it slides as a plug, as depth-averaged tools assume.
- **Internal friction of 40 deg, four levels of particles**: largest speed and area lie within those of the tools and within 8 %
  of their medians. The front lies within theirs, 40 m beyond the median. CSI is at the median, or up to 0.02 below.
- **43 deg, what `runout check` states for this slope** (sin(phi) = 0.68): the largest speed is 1 % above the median of the tools;
  the front stays (3375 m), the area grows at every thickness, and CSI falls by 0.02 and 0.04.
- **30 deg is too fast, 50 deg too wide**: 47 m/s is above every tool; with 50 deg the CSI at 0.5 m is 0.80.
- **One level of particles** agrees better in its outline and worse in its thickness (relative L1 0.84): the tail breaks into waves.
- **The front goes farther because the mass comes to the level ground at 39 m/s, the tools at 30 m/s (median).** It is thicker
  there (3 m, tools 2 m), and drag per mass falls with the thickness. Why it stretches less on the slope is open; cells of
  10 m and the polygon give the same front within 15 m."""
