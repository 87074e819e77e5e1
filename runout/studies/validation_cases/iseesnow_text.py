"""Text of the pages of ISeeSnow; their numbers are made in :mod:`runout.studies.validation_cases.iseesnow_numbers`."""

COULOMB_DIFFERENCES = """\
- **With 2 x 2 x 4 particles in cells of 5 m the area is below every tool. Reason: the slab is one particle thick.** Levels are a
  quarter of a cell; the slab is one of them. Its sides carry {one_pressure:.2f} of the hydrostatic pressure (last column,
  {coarse_pressure:.2f} in cells of 10 m), so it spreads too little to its sides and stays too thick. No thin rim is lost below a
  threshold: the area above 0.001 m is too small as well, and that above 1 m is too large.
- **More levels in the same cells mend it**, and so do flat cells and small cells. Four levels at 5 m: pressure {pressure:.2f},
  {more_area:+.1f} ha. So the default has four levels through releases thinner than half a cell, here 2 x 2 x 12. They take
  {cost:.1f} times the time of one.
- **The polygon has {less_mass:.1f} % less mass than the raster**, whose cells reach beyond it: less area and CSI at 0.1 m. With the
  mass of the raster its CSI is {heavy_csi:.3f}, that of the raster {csi:.3f}, of the tools {tools_csi:.3f} (median). Its partly
  filled cells lower the pressure of the rim.
- With cells of 10 m the map smooths particles that are far apart, which hides a part of the deficit of one level.
- What is left to the median of the tools, {left:.1f} ha with cells of 5 m and {left_fine:.1f} ha with 2.5 m, is in the run-out
  zone. The tools have hydrostatic pressure; internal friction resists spreading (compare [Frank Slide](frank_slide.md), where
  this was measured).
- The front stops {behind:.0f} m before the median, where {near} stop ({near_least:.0f} to {near_most:.0f} m). The tools' fronts
  spread over {spread:.0f} m.
- Peak thickness in the track is above the median of the tools by up to {thicker:.1f} m, and up to {thinner:.1f} m below it where
  the track begins."""
TOPO_DIFFERENCES = """\
- **Internal friction decides whether the base can pass on the drag.** On 34 deg a steady Voellmy flow needs {load:.3f} of its
  load as shear, and a mass of internal friction phi passes on sin(phi) at most. With drag at the base (law `voellmy_base`) and 30
  deg the mass shears over a slow base: {base_speed:.0f} m/s; the fastest tool has {fastest:.0f} m/s.
- **Drag over the column (law `voellmy`), as depth-averaged tools mean it, needs no internal friction.** With 30 deg and four
  levels of particles in cells of 5 m, the front lies {polygon_beyond:.0f} m (polygon) and {raster_beyond:.0f} m (raster) beyond
  the median of the tools. The largest speed differs from their median by {speed_error:.1f} % at most; CSI at 0.1 m is
  {csi_least:.3f} to {csi_most:.3f}, that of the tools {csi_median:.3f} (median).
- **More internal friction takes runout away from the tools.** With 40 deg in place of 30 deg the front goes {farther:.0f} m
  farther, the area grows by {grown:.1f} ha and CSI falls by {fallen:.2f}. Where the channel narrows, internal friction allows
  passive earth pressure across the flow; the tools have hydrostatic pressure. The mass then gathers late and is thick farther
  down.
- **In the lower half runout stays thicker and faster than the median of the tools** also with 30 deg (figure): its surge is less
  stretched. After 60 s its largest cross-section, by size of the cells, is {sections}.
  com1DFA has {com1dfa_section:.0f} m². With {weak:g} deg it is {weak_section:.0f} m²; friction at the base needs nearly all of that
  strength.
- **Internal friction where the channel narrows makes most of that difference.** It holds the sides back from the thalweg. There
  the flow is thinner and slower than in the tools, {narrow_thickness:.2f} m and {narrow_speed:.1f} m/s, and stretches later. With
  5 deg, and Coulomb friction of the whole column as in depth-averaged tools, the values are {fluid_thickness:.2f} m and
  {fluid_speed:.1f} m/s, those of the tools {tools_thickness:.2f} m and {tools_speed:.1f} m/s. The cross-section is
  {fluid_section:.0f} m²: {share:.0f} % of the difference is gone. The same friction with 30 deg gives {whole_section:.0f} m².
- **Lower pressure fits the rest, and most of the thickness in the lower half.** Pressure along the flow is {front_pressure:.2f}
  (front half) and {rear_pressure:.2f} (rear half) of the hydrostatic one. By its source, com1DFA
  takes gravity and distances in plan: on this slope that is {plan:.2f} times the hydrostatic pressure. With 0.6 of it com1DFA
  moves as the run with 5 deg:
  {weak_pressure:.0f} m², and {cut_lower:.2f} m in the lower half. There the run with 5 deg has {fluid_lower:.2f} m, that with 30
  deg {narrow_lower:.2f} m, com1DFA {com1dfa_lower:.2f} m, the tools {tools_lower:.2f} m.
- **Equal speeds across the flow are not the reason**: they make com1DFA slower, {plug_speed:.1f} m/s in the lower half in place of
  {com1dfa_speed:.1f} m/s. Nor is pressure across alone: twice of it leaves com1DFA's cross-section at {across_section:.0f} m².
- com1DFA's artificial viscosity hides a part of the difference: without it its cross-section is {inviscid:.0f} m².
- **Acceleration agrees with the law**: a rigid slab of 1.5 m slides {slab:.0f} m in plan in 20 s, the median of the mass of
  runout {median:.0f} m.

{terms}

One term changed in runout (5 m, raster) and in com1DFA (AvaFrame {avaframe}, 5 m, polygon). *Section*: largest cross-section.
*Length*: that of nine tenths of the volume. *Narrowing*, *lower half*: means of the peaks along the thalweg, 400 to 800 m and
1000 to 2100 m. *Whole column*: Coulomb friction slows the column as drag does. *Plug*: cross-sections move with their mean
velocity. All but com1DFA, standard and plug, end after 100 s. `tests/benchmarks/idealized_topo_com1dfa.py` makes the rows."""
