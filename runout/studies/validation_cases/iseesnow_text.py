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
- **More internal friction takes runout away from the tools.** With 40 deg in place of 30 deg the front goes 20 m farther, the area
  grows by 1.8 ha and CSI falls by 0.06. Where the channel narrows, internal friction allows passive earth pressure across the
  flow; the tools have hydrostatic pressure. The mass then gathers late and is thick farther down.
- **In the lower half runout stays thicker and faster than the median of the tools** also with 30 deg (figure), since its surge
  stretches less. Largest cross-section of the flow after 60 s: 154 m² with cells of 5 m, 163 m² with 3.3 m, 161 m² with 2.5 m in
  plan, 158 m² with cells 2 m high; com1DFA (AvaFrame 2.1) 131 m², and 338 m² without pressure. So pressure stretches the surge.
  That along the flow in runout is 0.83 (front half) and 0.69 (rear half) of the hydrostatic one. Why is open: with 24 deg in place
  of 30 deg it is 0.85 and 0.73, and the cross-sections change by at most 3 %. The flow is dense, as thick as its mass needs.
- **Acceleration agrees with the law**: a rigid slab of 1.5 m slides 265 m in plan in 20 s. The median of the mass of runout moves
  260 m, that of com1DFA 225 m."""
