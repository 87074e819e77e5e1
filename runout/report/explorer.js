// The explorer: draws one map with BokehJS from the content that explorer.py packed, and reads its cells.
"use strict";
(async () => {
  const byId = (name) => document.getElementById(`explorer-${name}`);
  const message = byId("message");
  const dark = window.matchMedia("(prefers-color-scheme: dark)");

  async function unpacked(name) {
    const packed = Uint8Array.from(atob(byId(name).textContent), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).arrayBuffer();
  }

  function element(tag, text = "", attributes = {}) {
    const made = document.createElement(tag);
    made.textContent = text;
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    return made;
  }

  if (typeof DecompressionStream === "undefined") {
    message.textContent = "This browser cannot unpack the map (it lacks DecompressionStream: Chrome 80, Firefox 113, Safari 16.4 or later have it). The printed maps and hazard.nc hold the same values.";
    return;
  }
  const script = element("script", new TextDecoder().decode(await unpacked("bokeh")));
  document.head.append(script); // BokehJS, run at once
  const buffer = await unpacked("content");
  const length = new DataView(buffer).getUint32(0, true);
  const content = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const bytes = new Uint8Array(buffer, 4 + length);

  // ---- values ----
  const planes = new Map();
  function plane(family, level) { // codes of one level, row 0 in the north
    const key = `${family.offset}/${level}`;
    if (planes.has(key)) return planes.get(key);
    const {rows, columns} = content.grids[family.grid], size = rows * columns, start = family.offset + 2 * size * level;
    const codes = new Uint16Array(size);
    for (let k = 0; k < size; k++) {
      const before = k % columns ? codes[k - 1] : 0;
      codes[k] = before + bytes[start + k] + 256 * bytes[start + size + k];
    }
    if (family.grid === "products") planes.set(key, codes); // those of members are many, and read one at a time
    return codes;
  }
  const valueOf = (family, code) => (code ? family.low + (code - 1) * family.step : NaN);

  function cellAt(grid, x, y) { // index of the cell at a place; -1 beyond the grid
    const column = Math.floor((x - grid.west) / grid.dx), row = Math.floor((grid.north - y) / grid.dy);
    return column >= 0 && column < grid.columns && row >= 0 && row < grid.rows ? row * grid.columns + column : -1;
  }

  function classOf(family, value) { // -1: no colour
    if (Number.isNaN(value) || (value === 0 && !family.opaque)) return -1;
    let k = family.edges.length - 1;
    while (k > 0 && value < family.edges[k] - 1e-6 * family.step) k--;
    return value < family.edges[0] - 1e-6 * family.step && !family.opaque ? (value < 0 ? 0 : -1) : k;
  }

  function shown(family, value) {
    if (Number.isNaN(value)) return "none";
    if (family.labels.length) return value ? family.labels[value - 1] ?? "none" : "none";
    return `${value.toFixed(family.decimals)}${family.unit ? "\u202f" + family.unit : ""}`;
  }

  // ---- state and map ----
  const families = content.families;
  const state = {family: content.first[0], level: content.first[1], member: 0, until: Infinity, place: null};
  const family = () => families[state.family];
  const level = () => (family().grid === "members" ? state.member : Math.min(state.level, family().levels.length - 1));

  const Plotting = Bokeh.Plotting, {Uint32NDArray} = Bokeh.require("core/util/ndarray");
  const figure = Plotting.figure({
    x_range: new Bokeh.Range1d(), y_range: new Bokeh.Range1d(), sizing_mode: "stretch_both", toolbar_location: null, tools: "",
    output_backend: "canvas", min_border: 2, lod_threshold: null,
  });
  const pan = new Bokeh.PanTool(), wheel = new Bokeh.WheelZoomTool({zoom_on_axis: false});
  figure.add_tools(pan, wheel);
  figure.toolbar.active_drag = pan;
  figure.toolbar.active_scroll = wheel;
  for (const ground of content.ground) {
    const [west, east, south, north] = ground.extent;
    figure.image_url({url: [ground.image], x: west, y: north, w: east - west, h: north - south, anchor: "top_left"});
  }
  const grid = () => content.grids[family().grid];
  const values = new Bokeh.ColumnDataSource({data: {image: [], x: [], y: [], dw: [], dh: []}});
  const painted = figure.image_rgba({image: {field: "image"}, x: {field: "x"}, y: {field: "y"}, dw: {field: "dw"}, dh: {field: "dh"}, source: values, origin: "top_left", anchor: "top_left", global_alpha: 0.8});

  function paint() {
    const chosen = family(), codes = plane(chosen, level()), {rows, columns, west, north, dx, dy} = grid();
    const colours = chosen.colours.map((c) => (0xff000000 | (parseInt(c.slice(5, 7), 16) << 16) | (parseInt(c.slice(3, 5), 16) << 8) | parseInt(c.slice(1, 3), 16)) >>> 0);
    const of = new Map(), pixels = new Uint32NDArray(rows * columns, [rows, columns]);
    for (let k = 0; k < codes.length; k++) {
      const code = codes[k];
      if (!of.has(code)) {
        const value = valueOf(chosen, code), at = chosen.time && value > state.until ? -1 : classOf(chosen, value);
        of.set(code, at < 0 ? 0 : colours[at]);
      }
      pixels[k] = of.get(code);
    }
    values.data = {image: [pixels], x: [west], y: [north], dw: [columns * dx], dh: [rows * dy]};
  }

  function drawLegend() {
    const chosen = family(), list = element("ul"), edges = chosen.edges;
    edges.map((edge, k) => k).reverse().forEach((k) => {
      const row = element("li"), swatch = element("i");
      swatch.style.background = chosen.colours[k];
      const first = k === 0 && edges[0] === 0 && !chosen.opaque ? "above 0" : `${edges[k]}`;
      const last = k + 1 < edges.length ? ` to ${edges[k + 1]}` : k ? " or more" : "";
      row.append(swatch, element("span", chosen.labels[k] ?? `${first}${last}`));
      list.append(row);
    });
    const title = element("b", `${chosen.title}${chosen.levels[level()] ? ", " + (chosen.grid === "members" ? "member " : "") + chosen.levels[level()] : ""}`);
    const unit = element("div", `${chosen.group}${chosen.unit ? " [" + chosen.unit + "]" : ""}; step ${chosen.step} ${chosen.unit}`);
    byId("legend").replaceChildren(title, unit, list);
  }

  // ---- readout ----
  const rows = [];
  function buildReadout() {
    let group = "";
    for (const one of families) {
      if (one.group !== group) {
        const head = element("tr");
        head.append(element("th", group = one.group, {colspan: 2, scope: "colgroup"}));
        byId("readout").append(head);
      }
      const row = element("tr"), cell = element("td");
      row.append(element("th", one.title, {scope: "row"}), cell);
      byId("readout").append(row);
      rows.push([one, row, cell]);
    }
  }

  function read(place) {
    state.place = place;
    const [x, y] = place, at = {products: cellAt(content.grids.products, x, y), members: cellAt(content.grids.members, x, y)};
    byId("place").textContent = `Easting ${x.toFixed(0)} m, northing ${y.toFixed(0)} m` + (at.products < 0 ? "; beyond the cells of the map" : "");
    for (const [one, row, cell] of rows) {
      row.className = one === family() ? "chosen" : "";
      const levels = one.grid === "members" ? [state.member] : one.levels.map((_, k) => k), index = at[one.grid];
      cell.replaceChildren(...levels.map((k) => {
        const part = element("span"), words = one.grid === "members" ? `member ${one.levels[k]}` : one.levels[k];
        if (words) part.append(element("small", `${words}: `));
        part.append(index < 0 ? "\u2013" : shown(one, valueOf(one, plane(one, k)[index])));
        return part;
      }));
    }
  }

  // ---- marks ----
  const details = byId("details");
  function drawMarks() {
    for (const group of content.marks) {
      const renderers = [];
      const lines = group.items.filter((item) => item.kind !== "point").flatMap((item) => item.parts);
      const points = group.items.filter((item) => item.kind === "point").map((item) => item.parts[0]);
      if (lines.length) {
        const xs = lines.map((part) => part[0]), ys = lines.map((part) => part[1]);
        renderers.push(figure.multi_line({xs, ys, line_color: "#ffffff", line_width: 4, line_alpha: 0.7}));
        renderers.push(figure.multi_line({xs, ys, line_color: group.colour, line_width: 2}));
      }
      if (points.length) renderers.push(figure.scatter({x: points.map((p) => p[0][0]), y: points.map((p) => p[1][0]), size: 10, fill_color: group.colour, line_color: "#ffffff", marker: "circle"}));
      const box = element("input", "", {type: "checkbox"}), label = element("label"), line = element("b");
      const show = () => renderers.forEach((one) => (one.visible = box.checked));
      line.style.borderColor = group.colour;
      box.checked = group.shown;
      box.addEventListener("change", show);
      label.append(box, line, group.name);
      byId("groups").append(label);
      show();
    }
  }

  // ---- view ----
  function fit(middle, perPixel) { // one scale on both axes
    const width = figureView.frame.bbox.width, height = figureView.frame.bbox.height;
    if (!(width > 0 && height > 0)) return;
    figure.x_range.setv({start: middle[0] - 0.5 * width * perPixel, end: middle[0] + 0.5 * width * perPixel});
    figure.y_range.setv({start: middle[1] - 0.5 * height * perPixel, end: middle[1] + 0.5 * height * perPixel});
  }
  function view() {
    const {x_range: x, y_range: y} = figure;
    return {middle: [0.5 * (x.start + x.end), 0.5 * (y.start + y.end)], perPixel: (x.end - x.start) / figureView.frame.bbox.width};
  }
  function showAll() {
    const [west, east, south, north] = content.view, {width, height} = figureView.frame.bbox;
    fit([0.5 * (west + east), 0.5 * (south + north)], Math.max((east - west) / width, (north - south) / height));
  }
  function move(right, up, zoom = 1) {
    const {middle, perPixel} = view(), step = 60 * perPixel;
    fit([middle[0] + right * step, middle[1] + up * step], perPixel / zoom);
    if (right || up) read(view().middle);
  }

  function applyTheme() {
    const ink = dark.matches ? "#e6eaee" : "#1d2733", paper = dark.matches ? "#1a2027" : "#ffffff";
    figure.setv({background_fill_color: dark.matches ? "#2a323b" : "#e9ebee", border_fill_color: paper, outline_line_color: ink});
    for (const axis of [...figure.below, ...figure.left]) axis.setv({axis_label_text_color: ink, major_label_text_color: ink, axis_line_color: ink, major_tick_line_color: ink, minor_tick_line_color: null});
  }

  // ---- controls ----
  function buildControls() {
    let heading = null;
    families.forEach((one, k) => {
      if (heading?.label !== one.group) byId("family").append((heading = element("optgroup", "", {label: one.group})));
      heading.append(element("option", one.title, {value: k}));
    });
    byId("family").value = state.family;
    const last = Math.max(0, ...families.filter((one) => one.time).map(latest));
    byId("family").addEventListener("change", (event) => choose(Number(event.target.value)));
    byId("level").addEventListener("change", (event) => { state.level = Number(event.target.value); update(); });
    byId("member").addEventListener("input", (event) => { state.member = Number(event.target.value); update(); });
    byId("time").addEventListener("input", (event) => {
      const share = event.target.value / event.target.max;
      state.until = share === 1 ? Infinity : share * last;
      byId("time-text").textContent = share === 1 ? "the end" : `${state.until.toFixed(last > 60 ? 0 : 1)} s`;
      update();
    });
    byId("time-text").textContent = "the end";
    byId("opacity").addEventListener("input", (event) => { painted.glyph.global_alpha = event.target.value / 100; });
    byId("in").addEventListener("click", () => move(0, 0, 1.5));
    byId("out").addEventListener("click", () => move(0, 0, 1 / 1.5));
    byId("reset").addEventListener("click", showAll);
    const keys = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1], "+": [0, 0, 1.5], "=": [0, 0, 1.5], "-": [0, 0, 1 / 1.5]};
    byId("map").addEventListener("keydown", (event) => {
      if (event.key === "0") showAll();
      else if (keys[event.key] && !event.ctrlKey && !event.metaKey) move(...keys[event.key]);
      else return;
      event.preventDefault();
    });
  }
  function latest(one) {
    let most = 0;
    const size = content.grids[one.grid].rows * content.grids[one.grid].columns;
    one.levels.forEach((_, k) => { const codes = plane(one, k); for (let i = 0; i < size; i++) if (codes[i] > most) most = codes[i]; });
    return most ? valueOf(one, most) : 0;
  }
  function choose(k) {
    state.family = k;
    const one = family(), members = one.grid === "members";
    byId("level-label").hidden = members || one.levels.length < 2;
    byId("member-label").hidden = !members;
    byId("time-label").hidden = !one.time;
    if (members) byId("member").max = one.levels.length - 1;
    else {
      byId("level-label").firstElementChild.textContent = one.choice;
      state.level = Math.min(state.level, one.levels.length - 1);
      byId("level").replaceChildren(...one.levels.map((words, at) => element("option", words, {value: at})));
      byId("level").value = state.level;
    }
    update();
  }
  function update() {
    byId("member-text").textContent = family().grid === "members" ? family().levels[state.member] : "";
    paint();
    drawLegend();
    if (state.place) read(state.place);
  }

  // ---- start ----
  const axis = {formatter: new Bokeh.BasicTickFormatter({use_scientific: false}), major_label_text_font_size: "11px", axis_label_text_font_style: "normal"};
  figure.below[0].setv({...axis, axis_label: "Easting [m]"});
  figure.left[0].setv({...axis, axis_label: "Northing [m]", major_label_orientation: "vertical"});
  figure.below[0].ticker.desired_num_ticks = figure.left[0].ticker.desired_num_ticks = 4;
  for (const one of figure.center.filter((part) => part instanceof Bokeh.Grid)) one.visible = false;
  figure.add_layout(new Bokeh.ScaleBar({range: figure.x_range, unit: "m", location: "bottom_left", background_fill_alpha: 0.75, border_line_color: null, length_sizing: "adaptive", bar_length: 0.2}));
  byId("attribution").textContent = content.attribution;
  applyTheme();
  dark.addEventListener("change", applyTheme);
  buildReadout();
  drawMarks();
  buildControls();
  const figureView = await Plotting.show(figure, byId("map"));
  message.hidden = true;
  choose(state.family);
  showAll();
  figure.on_event("mousemove", (event) => read([event.x, event.y]));
  figure.on_event("tap", (event) => read([event.x, event.y]));
  let last = null;
  new ResizeObserver(() => requestAnimationFrame(() => (last ? fit(last.middle, last.perPixel) : showAll()))).observe(byId("map"));
  document.documentElement.dataset.explorer = "ready";
})().catch((error) => {
  document.getElementById("explorer-message").hidden = false;
  document.getElementById("explorer-message").textContent = `The map cannot be drawn (${error.message}). The printed maps and hazard.nc hold the same values.`;
  throw error;
});
