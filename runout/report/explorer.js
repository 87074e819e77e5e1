// The explorer: draws one map with BokehJS from the content that explorer.py packed, and reads its cells.
"use strict";
(async () => {
  const byId = (name) => document.getElementById(`explorer-${name}`);
  const INSTEAD = "hazard.nc and the GeoTIFF files hold the same values.";

  function element(tag, text = "", attributes = {}) { // texts of users enter the page here, as text
    const made = document.createElement(tag);
    made.textContent = text;
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    return made;
  }

  async function unpack(name) {
    const packed = Uint8Array.from(atob(byId(name).textContent), (letter) => letter.charCodeAt(0));
    return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
  }

  if (typeof DecompressionStream === "undefined") {
    byId("message").textContent =
      `This browser cannot unpack the map: it has no DecompressionStream (Chrome 80, Firefox 113, Safari 16.4 or later). ${INSTEAD}`;
    return;
  }
  const text = new TextDecoder();
  document.head.append(element("script", text.decode(await unpack("bokeh")))); // defines Bokeh
  const buffer = await unpack("content"), length = new DataView(buffer).getUint32(0, true);
  const content = JSON.parse(text.decode(new Uint8Array(buffer, 4, length))), bytes = new Uint8Array(buffer, 4 + length);
  const {families, grids} = content, {Plotting} = Bokeh, {Uint32NDArray} = Bokeh.require("core/util/ndarray");

  // ---- values of cells ----
  const planes = new Map();
  function plane(family, level) { // codes (rows * columns) of a level, row 0 in the north
    const key = `${family.offset}/${level}`;
    if (planes.has(key)) return planes.get(key);
    const {rows, columns} = grids[family.grid], size = rows * columns, start = family.offset + 2 * size * level;
    const codes = new Uint16Array(size);
    for (let k = 0; k < size; k++) {
      codes[k] = (k % columns ? codes[k - 1] : 0) + bytes[start + k] + 256 * bytes[start + size + k];
    }
    if (family.grid === "products") planes.set(key, codes); // members are many, and are read one at a time
    return codes;
  }

  const valueOf = (family, code) => (code ? family.low + (code - 1) * family.step : NaN);

  function cellAt(grid, x, y) { // index of the cell at a place; -1 beyond the grid
    const column = Math.floor((x - grid.west) / grid.dx), row = Math.floor((grid.north - y) / grid.dy);
    return column >= 0 && column < grid.columns && row >= 0 && row < grid.rows ? row * grid.columns + column : -1;
  }

  function classOf(family, value) { // number of the class from 0 on; -1 for no colour
    if (Number.isNaN(value) || (value === 0 && !family.opaque)) return -1;
    let k = family.edges.length - 1;
    while (k > 0 && value < family.edges[k] - 1e-6 * family.step) k--;
    return k === 0 && !family.opaque && family.edges[0] > 0 && value < family.edges[0] ? -1 : k;
  }

  function printed(family, value) {
    if (Number.isNaN(value)) return "none";
    if (family.named) return family.labels[value - 1] ?? "none";
    const digits = family.decimals > 4 ? `${Number(value.toPrecision(3))}` : value.toFixed(family.decimals);
    return `${value === 0 ? "0" : digits.replace("-", "\u2212")}${family.unit && "\u202f" + family.unit}`;
  }

  // ---- the chosen map ----
  const state = {family: content.first[0], levels: {}, until: Infinity, place: null};
  const chosen = () => families[state.family];
  const isSlider = (family) => ["Member", "Snapshot"].includes(family.choice);
  const keyOf = (family) => (["Threshold", "Condition"].includes(family.choice) ? family.name : family.choice); // alike maps share a level
  const levelOf = (family) => Math.min(state.levels[keyOf(family)] ?? (family.choice === "Percentile" ? family.levels.length >> 1 : 0), family.levels.length - 1);
  state.levels[keyOf(chosen())] = content.first[1];

  const figure = Plotting.figure({
    x_range: new Bokeh.Range1d({start: content.view[0], end: content.view[1]}), y_range: new Bokeh.Range1d({start: content.view[2], end: content.view[3]}),
    sizing_mode: "stretch_both", toolbar_location: null, tools: "", min_border: 0, min_border_top: 4, // explorer.css cuts the top of it off
  });
  const drawPicture = ({extent: [west, east, south, north], image}) =>
    figure.image_url({url: [image], x: west, y: north, w: east - west, h: north - south, anchor: "top_left"});
  content.ground.forEach(drawPicture);
  const orthophoto = content.orthophoto && drawPicture(content.orthophoto);
  const cells = new Bokeh.ColumnDataSource({data: {image: [], x: [], y: [], dw: [], dh: []}});
  const columns = Object.fromEntries(["image", "x", "y", "dw", "dh"].map((field) => [field, {field}]));
  const painted = figure.image_rgba({...columns, source: cells, origin: "top_left", anchor: "top_left", global_alpha: 0.8});

  function paint() {
    const family = chosen(), codes = plane(family, levelOf(family)), grid = grids[family.grid];
    const colours = family.colours.map((hex) => [1, 3, 5].reduce((sum, at, k) => sum + parseInt(hex.slice(at, at + 2), 16) * 256 ** k, 255 * 256 ** 3));
    const colourOf = new Map([[0, 0]]), pixels = new Uint32NDArray(codes.length, [grid.rows, grid.columns]);
    codes.forEach((code, k) => {
      if (!colourOf.has(code)) {
        const value = valueOf(family, code), place = family.time && value > state.until ? -1 : classOf(family, value);
        colourOf.set(code, place < 0 ? 0 : colours[place]);
      }
      pixels[k] = colourOf.get(code);
    });
    cells.data = {image: [pixels], x: [grid.west], y: [grid.north], dw: [grid.columns * grid.dx], dh: [grid.rows * grid.dy]};
  }

  function drawLegend() {
    const family = chosen(), level = family.levels[levelOf(family)], list = element("ul");
    for (let k = family.edges.length - 1; k >= 0; k--) {
      const row = element("li"), swatch = element("i");
      swatch.style.background = family.colours[k];
      row.append(swatch, element("span", family.labels[k]));
      list.append(row);
    }
    const step = family.named ? "" : `rounded to ${family.step}${family.unit && "\u202f" + family.unit}`;
    const heading = family.choice === "Member" ? family.title.replace("Member", `Member ${level}`) : `${family.title}${level && `: ${level}`}`;
    byId("legend").replaceChildren(element("b", heading), element("div", `${family.unit ? `[${family.unit}], ` : ""}${step}`), list);
  }

  // ---- values of all maps at a place ----
  const rows = [];
  function buildReadout() {
    let group = "";
    for (const family of families) {
      if (family.group !== group) {
        const row = element("tr");
        row.append(element("th", (group = family.group), {colspan: 2, scope: "colgroup"}));
        byId("readout").append(row);
      }
      const row = element("tr"), cell = element("td");
      row.append(element("th", family.title, {scope: "row"}), cell);
      byId("readout").append(row);
      rows.push({family, row, cell});
    }
  }

  function read(x, y) {
    state.place = [x, y];
    const at = {products: cellAt(grids.products, x, y), members: cellAt(grids.members, x, y)}, digits = grids.products.dx < 2 ? 1 : 0;
    const [east, north] = content.axes;
    byId("place").textContent = `${east} ${x.toFixed(digits)} m, ${north.toLowerCase()} ${y.toFixed(digits)} m${at.products < 0 ? ": beyond the cells of the maps" : ""}`;
    for (const {family, row, cell} of rows) {
      row.className = family === chosen() ? "explorer-chosen" : "";
      const levels = isSlider(family) ? [levelOf(family)] : family.levels.map((_, k) => k), index = at[family.grid];
      cell.replaceChildren(...levels.map((k) => {
        const part = element("span"), words = `${family.choice === "Member" ? "member " : ""}${family.levels[k]}`;
        if (words) part.append(element("small", `${words}: `));
        part.append(index < 0 ? "\u2013" : printed(family, valueOf(family, plane(family, k)[index])));
        return part;
      }));
    }
  }

  // ---- marks ----
  const hovered = [], pins = new Bokeh.ColumnDataSource({data: {x: [], y: []}});
  function pin(x, y) { // a place that stays, of a tap or a key
    pins.data = {x: [x], y: [y]};
    read(x, y);
  }

  function drawShapes(group, items, kind) {
    const shapes = items.flatMap((item) => item.parts.map((part) => ({item, part})));
    if (!shapes.length) return [];
    const labels = shapes.map(({item}) => item.label), lines = {xs: shapes.map(({part}) => part[0]), ys: shapes.map(({part}) => part[1])};
    const source = new Bokeh.ColumnDataSource({data: kind === "point" ? {x: lines.xs.flat(), y: lines.ys.flat(), labels} : {...lines, labels}});
    const steady = {nonselection_line_alpha: 1, nonselection_fill_alpha: kind === "area" ? 0.35 : 1, source};
    let shown;
    if (kind === "point") {
      shown = figure.scatter({x: {field: "x"}, y: {field: "y"}, size: 11, fill_color: group.colour, line_color: "#ffffff", ...steady});
    } else if (kind === "area") {
      shown = figure.patches({xs: {field: "xs"}, ys: {field: "ys"}, fill_color: "#ffffff", fill_alpha: 0.35, line_color: group.colour, line_width: 2, ...steady});
    } else {
      shown = figure.multi_line({xs: {field: "xs"}, ys: {field: "ys"}, line_color: group.colour, line_width: 2.5, nonselection_line_alpha: 1, source});
    }
    hovered.push(shown);
    source.selected.properties.indices.change.connect(() => {
      const [k] = source.selected.indices;
      if (k !== undefined && shapes[k].item.details) open(shapes[k].item);
    });
    const halo = kind === "line" ? [figure.multi_line({...lines, line_color: "#ffffff", line_width: 4.5, line_alpha: 0.6, level: "underlay"})] : [];
    return [...halo, shown];
  }

  function drawGroup(group) {
    const areas = group.items.some((item) => item.details) || group.name.startsWith("Obstacles"), of = {point: [], line: [], area: []};
    for (const item of group.items) of[item.kind === "point" ? "point" : item.kind === "polygon" && areas ? "area" : "line"].push(item);
    const renderers = Object.entries(of).flatMap(([kind, items]) => drawShapes(group, items, kind));
    const named = group.items.filter((item) => item.label && item.details);
    if (named.length) {
      renderers.push(figure.text({
        x: named.map((item) => item.middle[0]), y: named.map((item) => item.middle[1]), text: named.map((item) => item.label), x_offset: 8, y_offset: -6,
        text_font_size: "12px", text_color: group.colour, background_fill_color: "#ffffff", background_fill_alpha: 0.8, padding: 2,
      }));
    }
    return {renderers, named};
  }

  function addSwitch(name, colour, shown, renderers) {
    const box = element("input", "", {type: "checkbox"}), label = element("label"), line = element("b");
    const show = () => renderers.forEach((one) => { one.visible = box.checked; });
    line.style.borderColor = colour;
    box.checked = shown;
    box.addEventListener("change", show);
    label.append(box, line, name);
    byId("groups").append(label);
    show();
  }

  function drawMarks() {
    if (orthophoto) addSwitch("Orthophoto", "transparent", true, [orthophoto]);
    for (const group of content.marks) {
      const {renderers, named} = drawGroup(group);
      addSwitch(group.name, group.colour, group.shown, renderers);
      if (!named.length) continue;
      const list = element("select", "", {"aria-label": `Open one of: ${group.name}`});
      list.append(element("option", "Open \u2026", {value: ""}), ...named.map((item, k) => element("option", item.label, {value: k})));
      list.addEventListener("change", () => list.value && open(named[list.value]));
      byId("groups").append(list);
    }
  }

  function tableOf(rows) {
    const table = element("table");
    for (const [heading, value] of rows) {
      const row = element("tr");
      row.append(element("th", heading, {scope: "row"}), element("td", value));
      table.append(row);
    }
    return table;
  }

  async function drawChart(chart, along, target) {
    const plot = Plotting.figure({height: 150, sizing_mode: "stretch_width", toolbar_location: null, tools: "", min_border: 2, min_border_left: 84});
    const known = (values) => values.map((value) => value ?? NaN), x = chart.x;
    if (chart.band) plot.varea({x, y1: known(chart.band.low), y2: known(chart.band.high), fill_color: chart.lines[0].colour, fill_alpha: 0.25});
    for (const line of chart.lines) plot.line({x, y: known(line.y), line_color: line.colour, line_width: 2, ...(line.name && {legend_label: line.name})});
    plot.left[0].axis_label = `${chart.title}${chart.unit && ` [${chart.unit}]`}`;
    plot.below[0].axis_label = along;
    for (const axis of [plot.below[0], plot.left[0]]) {
      axis.formatter = new Bokeh.BasicTickFormatter({use_scientific: false});
      axis.ticker.desired_num_ticks = 4;
    }
    theme(plot);
    await Plotting.show(plot, target);
  }

  let opened = 0;
  async function open(item) { // its tables or charts
    const turn = ++opened, details = byId("details"), {tables = [], charts = [], along = "", remark = ""} = item.details;
    details.replaceChildren(element("b", item.label), ...tables.map(tableOf), element("p", remark, {class: "explorer-note"}));
    for (const [k, chart] of charts.entries()) {
      if (turn !== opened) return; // another mark was opened meanwhile
      const target = element("div");
      details.lastElementChild.before(target);
      await drawChart(chart, k === charts.length - 1 ? along : "", target);
    }
    pin(...item.middle);
    const side = details.parentElement; // it scrolls by itself where it stands beside the map
    if (side.scrollHeight > side.clientHeight + 1) side.scrollTop = details.offsetTop - side.offsetTop;
    else details.scrollIntoView({block: "nearest"});
  }

  // ---- view: one scale on both axes ----
  let view = null; // middle, and metres of a pixel
  const frame = () => figureView.frame.bbox;
  function fit(middle, perPixel) {
    const {width, height} = frame();
    if (!(width > 0 && height > 0)) return;
    figure.x_range.setv({start: middle[0] - 0.5 * width * perPixel, end: middle[0] + 0.5 * width * perPixel});
    figure.y_range.setv({start: middle[1] - 0.5 * height * perPixel, end: middle[1] + 0.5 * height * perPixel});
    view = {middle, perPixel};
  }
  function current() {
    const {x_range: x, y_range: y} = figure;
    return {middle: [0.5 * (x.start + x.end), 0.5 * (y.start + y.end)], perPixel: (x.end - x.start) / frame().width};
  }
  function showAll() {
    const {width, height} = frame();
    fit([0.5 * (west + east), 0.5 * (south + north)], Math.max((east - west) / width, (north - south) / height));
  }
  function move(right, up, zoom = 1) {
    const {middle, perPixel} = current(), step = 60 * perPixel;
    fit([middle[0] + right * step, middle[1] + up * step], perPixel / zoom);
  }

  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  function theme(plot) {
    const ink = dark.matches ? "#e6eaee" : "#1d2733", paper = dark.matches ? "#1a2027" : "#ffffff";
    plot.setv({background_fill_color: dark.matches ? "#2a323b" : "#e9ebee", border_fill_color: paper, outline_line_color: ink});
    for (const grid of plot.center.filter((part) => part instanceof Bokeh.Grid)) grid.grid_line_color = dark.matches ? "#45505b" : "#ffffff";
    for (const axis of [...plot.below, ...plot.left]) {
      axis.setv({axis_label_text_color: ink, major_label_text_color: ink, axis_line_color: ink, major_tick_line_color: ink, minor_tick_line_color: null});
      axis.setv({axis_label_text_font_style: "normal", axis_label_text_font_size: "12px", major_label_text_font_size: "11px"});
    }
  }

  // ---- controls ----
  function buildList() {
    let heading = null;
    families.forEach((family, k) => {
      if (heading?.label !== family.group) byId("family").append((heading = element("optgroup", "", {label: family.group})));
      heading.append(element("option", family.title, {value: k}));
    });
    byId("family").value = state.family;
  }

  function choose(k) {
    state.family = k;
    const family = chosen(), several = family.levels.length > 1, slider = isSlider(family);
    byId("level-label").hidden = slider || !several;
    byId("slider-label").hidden = !slider;
    byId("time-label").hidden = !family.time;
    byId("play").hidden = !(family.time || (slider && several));
    byId("level-label").firstElementChild.textContent = byId("slider-label").firstElementChild.textContent = family.choice;
    byId("slider").max = family.levels.length - 1;
    byId("slider").value = levelOf(family);
    byId("level").replaceChildren(...family.levels.map((words, at) => element("option", words, {value: at})));
    byId("level").value = levelOf(family);
    update();
  }

  function setLevel(event) {
    state.levels[keyOf(chosen())] = Number(event.target.value);
    update();
  }

  function setTime() {
    const {value, max} = byId("time"), until = (value / max) * chosen().largest;
    state.until = value === max ? Infinity : until;
    byId("time-text").textContent = value === max ? "the end" : `${until.toFixed(until > 20 ? 0 : 1)}\u202fs`;
  }

  function update() {
    const family = chosen();
    if (family.time) setTime();
    const level = levelOf(family), words = family.choice === "Member" && content.members[level] ? ` (${content.members[level]})` : "";
    byId("slider-text").textContent = `${family.levels[level]}${words}`;
    paint();
    drawLegend();
    if (state.place) read(...state.place);
  }

  let timer = 0;
  function stop() {
    clearInterval(timer);
    timer = 0;
    byId("play").textContent = "Play";
  }
  function play() { // moves the slider of the time, or of members and snapshots
    if (timer) return stop();
    const moved = chosen().time ? byId("time") : byId("slider"), step = chosen().time ? 4 : 1;
    if (Number(moved.value) >= Number(moved.max)) moved.value = 0;
    byId("play").textContent = "Stop";
    timer = setInterval(() => {
      if (Number(moved.value) >= Number(moved.max)) return stop();
      moved.value = Number(moved.value) + step;
      moved.dispatchEvent(new Event("input"));
    }, chosen().time ? 80 : 600);
  }

  const KEYS = {
    ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1], "+": [0, 0, 1.5], "=": [0, 0, 1.5], "-": [0, 0, 1 / 1.5],
  };
  function listen() {
    byId("family").addEventListener("change", (event) => { stop(); choose(Number(event.target.value)); });
    byId("level").addEventListener("change", setLevel);
    byId("slider").addEventListener("input", setLevel);
    byId("time").addEventListener("input", update);
    byId("play").addEventListener("click", play);
    byId("opacity").addEventListener("input", (event) => { painted.glyph.global_alpha = event.target.value / 100; });
    byId("in").addEventListener("click", () => move(0, 0, 1.5));
    byId("out").addEventListener("click", () => move(0, 0, 1 / 1.5));
    byId("reset").addEventListener("click", showAll);
    byId("map").addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || !(event.key === "0" || KEYS[event.key])) return;
      event.preventDefault();
      if (event.key === "0") showAll();
      else move(...KEYS[event.key]);
      pin(...current().middle);
    });
    figure.on_event("mousemove", ({x, y}) => read(x, y));
    figure.on_event("tap", ({x, y}) => pin(x, y));
    for (const range of [figure.x_range, figure.y_range]) range.change.connect(() => { view = current(); });
    new ResizeObserver(() => requestAnimationFrame(() => (view ? fit(view.middle, view.perPixel) : showAll()))).observe(byId("map"));
    dark.addEventListener("change", () => theme(figure));
  }

  // ---- start ----
  function furnish() {
    const formatter = new Bokeh.BasicTickFormatter({use_scientific: false}), [east, north] = content.axes;
    figure.below[0].setv({formatter, axis_label: `${east} [m]`});
    figure.left[0].setv({formatter, axis_label: `${north} [m]`, major_label_orientation: "vertical"});
    for (const axis of [figure.below[0], figure.left[0]]) axis.ticker.desired_num_ticks = 4;
    for (const grid of figure.center.filter((part) => part instanceof Bokeh.Grid)) grid.visible = false;
    figure.add_layout(new Bokeh.ScaleBar({
      range: figure.x_range, unit: "m", location: "bottom_left", bar_length: 0.15, padding: 6, background_fill_alpha: 0.75, border_line_color: null,
    }));
    figure.scatter({x: {field: "x"}, y: {field: "y"}, source: pins, marker: "cross", size: 16, line_color: "#000000", line_width: 2});
    const pan = new Bokeh.PanTool(), wheel = new Bokeh.WheelZoomTool({zoom_on_axis: false});
    figure.add_tools(pan, wheel, new Bokeh.TapTool({renderers: hovered}), new Bokeh.HoverTool({renderers: hovered, tooltips: "@labels"}));
    figure.toolbar.setv({active_drag: pan, active_scroll: wheel});
    theme(figure);
  }

  const [west, east, south, north] = content.view;
  byId("map").style.setProperty("--x-aspect", (east - west) / (north - south));
  byId("attribution").textContent = content.attribution;
  buildReadout();
  drawMarks();
  buildList();
  furnish();
  const figureView = await Plotting.show(figure, byId("map"));
  byId("message").hidden = true;
  choose(state.family);
  showAll();
  listen();
  document.documentElement.dataset.explorer = "ready";
})().catch((error) => {
  const message = document.getElementById("explorer-message");
  message.hidden = false;
  message.textContent = `The map cannot be drawn (${error.message}). hazard.nc and the GeoTIFF files hold the same values.`;
  throw error;
});
