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
- **Internal friction decides whether the base can pass on the drag.** On 34 deg a steady Voellmy flow needs 0.675 of its load as
  shear, and a mass of internal friction phi passes on sin(phi) at most. With drag at the base (law `voellmy_base`) and 30 deg the
  mass shears over a slow base: 47 m/s, above every tool.
- **Drag over the column (law `voellmy`), as depth-averaged tools mean it, needs no internal friction.** With 30 deg and four
  levels of particles in cells of 5 m, the front lies 20 m (polygon) and 25 m (raster) beyond the median of the tools. The largest
  speed is within 1 % of their median, and CSI is 0.02 above it.
- **Internal friction lets the mass gather late where the channel narrows.** There the stress across the flow becomes passive
  earth pressure; the tools have hydrostatic pressure. With friction and drag both over the column (cells of 10 m), the peak
  thickness 525 m along the path is 3.0 m with 3 deg, 2.6 m with 20 deg and 2.1 m with 40 deg; the median of the tools is
  2.9 m. What gathers late is thick and fast farther down: 39 m/s at the level ground with 40 deg, the tools 30 m/s (median).
- **A depth-averaged particle-in-cell model shows the same.** On this terrain, with cells of 5 m, hydrostatic pressure gives a
  front at 3340 m and a CSI of 0.91 and 0.90, as the tools. Drucker-Prager earth pressure of 15, 30 and 40 deg gives 0.91, 0.88
  and 0.86 at 0.1 m; 40 deg puts the front at 3360 m with 23.0 ha, as runout does.
- **Contact is not the reason.** In each quarter of the mass the mean normal force is 0.98 to 1.04 of the weight (cells of 10 m),
  and the drag 0.99 to 1.02 of what the speed at the base and the area of the contacts give. That area is 1.04 to 1.2 of the wetted
  ground; at the thin tail up to 1.9, since rims count."""
