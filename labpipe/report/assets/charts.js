"use strict";
/* Interactive charts. uPlot supplies axes, scales, cursor and selection; the curves are drawn here,
   because every series has its own x, a loop runs back, and markers must differ in shape.
   All texts reach the page as textContent or on a canvas, never as markup. */
(() => {
  const PAN_SHARE = 0.1, KEY_ZOOM = 1.4, WHEEL_ZOOM = 1.0015, CURSOR_STEP_PX = 6;
  const SMALLEST_WINDOW = 1e-9, Y_MARGIN = 0.05, MARKER_PX = 3.2, ALONG_LINE_PX = 90, CROWDED_PX = 5;
  const SUPERSCRIPTS = "⁰¹²³⁴⁵⁶⁷⁸⁹";
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const charts = [];
  // Curves that show while they are pointed at: the chart pointed at, and what is due to be drawn.
  let pointed = null, isRedrawDue = false;

  // ---- data -------------------------------------------------------------------------------
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;

  const curve = (packed) => {
    if (packed === undefined) return null;
    return Float64Array.from(new Float32Array(bytes(packed.data)), (v) => packed.offset + packed.scale * v);
  };

  const decode = (description) => {
    const axes = description.axes.map((axis) => new Float64Array(bytes(axis)));
    return description.series.map((s) => ({
      ...s, x: axes[s.axis], y: curve(s.y), u: curve(s.u), low: curve(s.low), high: curve(s.high), shown: true,
    }));
  };

  /** First index whose value is not below the wanted one. */
  const lowerBound = (x, wanted) => {
    let a = 0, b = x.length;
    while (a < b) { const m = (a + b) >> 1; if (x[m] < wanted) a = m + 1; else b = m; }
    return a;
  };

  // ---- numbers ----------------------------------------------------------------------------
  const raised = (n) => (n < 0 ? "⁻" : "") + String(Math.abs(n)).replace(/\d/g, (d) => SUPERSCRIPTS[d]);
  const minus = (text) => text.replace("-", "−");

  const fixed = (value, decimals) => {
    const text = value.toFixed(Math.min(Math.max(decimals, 0), 12));
    return Number(text) === 0 ? text.replace("-", "") : minus(text);
  };

  /** Decimals that write a step such as 0.025 in full. */
  const decimalsOf = (step) => {
    let decimals = Math.max(-Math.floor(Math.log10(step) + 1e-9), 0);
    while (decimals < 15 && Math.abs(step * 10 ** decimals - Math.round(step * 10 ** decimals)) > 1e-6) decimals += 1;
    return decimals;
  };

  const tickText = (value, step) => {
    if (Math.abs(value) < step * 1e-6) return "0";
    const size = Math.floor(Math.log10(Math.abs(value)) + 1e-9);
    if (step < 1e-6 || Math.abs(value) >= 1e6) return `${fixed(value / 10 ** size, decimalsOf(step / 10 ** size))}·10${raised(size)}`;
    return fixed(value, decimalsOf(step));
  };

  const powerText = (value) => {
    const size = Math.floor(Math.log10(value) + 1e-9), digit = Math.round(value / 10 ** size);
    if (size >= -3 && size <= 3) return String(Number((digit * 10 ** size).toPrecision(3)));
    return digit === 1 ? `10${raised(size)}` : `${digit}·10${raised(size)}`;
  };

  /** A hovered value with as many digits as the window resolves. */
  const readout = (value, width) => {
    if (value === null || Number.isNaN(value)) return "–";
    if (value === 0) return "0";
    const size = Math.floor(Math.log10(Math.abs(value)));
    const step = Math.floor(Math.log10(width || Math.abs(value))) - 3;
    if (size >= 6 || size < -4) return `${fixed(value / 10 ** size, Math.min(Math.max(size - step, 0), 7))}·10${raised(size)}`;
    return fixed(value, Math.max(-step, 0));
  };

  /** Calendar date of days since 1970-01-01. */
  const dayText = (value) => (value % 1 === 0 ? new Date(value * 864e5).toISOString().slice(0, 10) : "");

  const logTicks = (low, high) => {
    const ticks = [];
    for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power += 1) {
      // Over many decades lines between the powers would grey the picture.
      for (let digit = 1; digit < (high / low > 1e12 ? 2 : 10); digit += 1) {
        const value = digit * 10 ** power;
        if (value >= low * (1 - 1e-9) && value <= high * (1 + 1e-9)) ticks.push(value);
      }
    }
    return ticks;
  };

  /** Texts of logarithmic ticks; `most` decades have room for a text each. */
  const logLabels = (ticks, most) => {
    const decades = Math.log10(ticks[ticks.length - 1] / ticks[0]);
    return ticks.map((value) => {
      const size = Math.floor(Math.log10(value) + 1e-9), digit = Math.round(value / 10 ** size);
      const every = Math.max(decades > 9 ? 2 : 1, Math.ceil(decades / most));
      const few = decades < 1 ? [1, 2, 3, 5, 7] : [1, 2, 5];
      const named = decades < 0.5 || (decades < 2 ? few.includes(digit) : digit === 1 && size % every === 0);
      return named ? powerText(value) : "";
    });
  };

  // ---- ranges -----------------------------------------------------------------------------
  const forward = (scale) => (scale === "log" ? Math.log10 : (v) => v);
  const backward = (scale) => (scale === "log" ? (v) => 10 ** v : (v) => v);

  const widened = (low, high, scale, margin) => {
    if (!(low <= high)) return scale === "log" ? [1, 10] : [0, 1];
    const f = forward(scale), g = backward(scale);
    const a = f(low), b = f(high);
    const extra = a === b ? (scale === "log" ? 0.2 : Math.abs(a) * 0.05 || 1) : (b - a) * margin;
    return [g(a - extra), g(b + extra)];
  };

  /** Visible range of y inside a window of x. */
  const heights = (chart, [from, to]) => {
    let low = Infinity, high = -Infinity;
    const isLog = chart.description.yScale === "log";
    const take = (v) => { if (v < low && !(isLog && v <= 0)) low = v; if (v > high) high = v; };
    for (const s of chart.series) {
      if (!s.shown) continue;
      const [first, last] = chart.isPlane ? [0, s.x.length] : [Math.max(lowerBound(s.x, from) - 1, 0), Math.min(lowerBound(s.x, to) + 1, s.x.length)];
      for (let i = first; i < last; i += 1) {
        if (s.low !== null) { take(s.low[i]); take(s.high[i]); continue; }
        // A neighbour outside the window bounds a line, but not a cloud of points.
        if (s.style === "points" && (s.x[i] < from || s.x[i] > to)) continue;
        take(s.y[i]);
        if (s.u !== null && s.u[i] === s.u[i]) { take(s.y[i] - s.u[i]); take(s.y[i] + s.u[i]); }
      }
    }
    // A difference is judged against 0, unless that lies too far away to show anything beside it.
    if (chart.hasResidual && !isLog && Math.min(Math.abs(low), Math.abs(high)) < 2 * (high - low)) take(0);
    const ends = widened(low, high, chart.description.yScale, Y_MARGIN);
    // Names of positions stand above the curves.
    if (chart.description.lines.length > 0) ends[1] = widened(...ends, chart.description.yScale, 2 * Y_MARGIN)[1];
    return ends;
  };

  // ---- drawing ----------------------------------------------------------------------------
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const inkOf = (s) => (dark.matches ? s.dark : s.light);

  /** Functions from values to canvas pixels, without a call into uPlot per point. */
  const projection = (u, description) => {
    const along = (key, scale, start, length, turned) => {
      const f = forward(scale), { min, max } = u.scales[key];
      const a = f(min), k = length / (f(max) - a);
      return turned ? (v) => start + length - (f(v) - a) * k : (v) => start + (f(v) - a) * k;
    };
    const { left, top, width, height } = u.bbox;
    return { px: along("x", description.xScale, left, width, false), py: along("y", description.yScale, top, height, true) };
  };

  const visible = (chart, s, u) => {
    if (chart.isPlane) return [0, s.x.length];
    return [Math.max(lowerBound(s.x, u.scales.x.min) - 1, 0), Math.min(lowerBound(s.x, u.scales.x.max) + 2, s.x.length)];
  };

  /** Where several samples fall into one column of pixels, their extremes stand for them. */
  const traceSorted = (path, s, y, [first, last], { px, py }) => {
    let column = NaN, low = 0, high = 0, end = 0, isDrawing = false;
    const flush = () => { if (column === column && low !== high) { path.lineTo(column, low); path.lineTo(column, high); path.lineTo(column, end); } };
    for (let i = first; i < last; i += 1) {
      const v = py(y[i]);
      if (v !== v) { flush(); column = NaN; isDrawing = false; continue; }
      const at = px(s.x[i]);
      const rounded = Math.round(at);
      if (isDrawing && rounded === column && last - first > 4000) {
        if (v < low) low = v;
        if (v > high) high = v;
        end = v;
        continue;
      }
      flush();
      if (!isDrawing) path.moveTo(at, v);
      else { if (s.style === "step") path.lineTo(at, end); path.lineTo(at, v); }
      isDrawing = true; column = rounded; low = high = end = v;
    }
    flush();
  };

  const traceLoop = (path, s, { px, py }) => {
    let isDrawing = false;
    for (let i = 0; i < s.x.length; i += 1) {
      const v = py(s.y[i]);
      if (v !== v) { isDrawing = false; continue; }
      if (isDrawing) path.lineTo(px(s.x[i]), v); else path.moveTo(px(s.x[i]), v);
      isDrawing = true;
    }
  };

  const drawBand = (ctx, s, range, { px, py }) => {
    ctx.globalAlpha = dark.matches ? 0.3 : 0.2;
    ctx.fillStyle = inkOf(s);
    let start = range[0];
    const fill = (stop) => {
      if (stop - start < 1) return;
      ctx.beginPath();
      for (let i = start; i < stop; i += 1) ctx.lineTo(px(s.x[i]), py(s.high[i]));
      for (let i = stop - 1; i >= start; i -= 1) ctx.lineTo(px(s.x[i]), py(s.low[i]));
      ctx.fill();
    };
    for (let i = range[0]; i <= range[1]; i += 1) {
      if (i < range[1] && s.low[i] === s.low[i] && s.high[i] === s.high[i]) continue;
      fill(i);
      start = i + 1;
    }
    ctx.globalAlpha = 1;
  };

  const outline = (path, marker, x, y, r) => {
    if (marker === "circle") { path.moveTo(x + r, y); path.arc(x, y, r, 0, 2 * Math.PI); return; }
    const corners = {
      square: [[-0.9, -0.9], [0.9, -0.9], [0.9, 0.9], [-0.9, 0.9]],
      triangle: [[0, -1.15], [1.1, 0.85], [-1.1, 0.85]],
      diamond: [[0, -1.25], [1.25, 0], [0, 1.25], [-1.25, 0]],
    }[marker];
    corners.forEach(([dx, dy], i) => (i ? path.lineTo(x + dx * r, y + dy * r) : path.moveTo(x + dx * r, y + dy * r)));
    path.closePath();
  };

  const drawMarkers = (ctx, s, points, density) => {
    const path = new Path2D();
    for (const [x, y] of points) outline(path, s.marker, x, y, MARKER_PX * density);
    ctx.fillStyle = s.filled ? inkOf(s) : colour("--page");
    ctx.strokeStyle = inkOf(s);
    ctx.lineWidth = 1.2 * density;
    ctx.setLineDash([]);
    ctx.fill(path);
    ctx.stroke(path);
  };

  const drawErrors = (ctx, s, [first, last], { px, py }, density) => {
    const path = new Path2D(), cap = 3 * density;
    for (let i = first; i < last; i += 1) {
      const x = px(s.x[i]);
      let low = py(s.y[i] - s.u[i]);
      const high = py(s.y[i] + s.u[i]);
      if (high !== high) continue;
      // On a logarithmic axis a bar that reaches zero runs out of the frame.
      if (!Number.isFinite(low)) low = ctx.canvas.height * 2;
      path.moveTo(x, low); path.lineTo(x, high);
      path.moveTo(x - cap, low); path.lineTo(x + cap, low);
      path.moveTo(x - cap, high); path.lineTo(x + cap, high);
    }
    ctx.strokeStyle = inkOf(s); ctx.lineWidth = density; ctx.setLineDash([]);
    ctx.stroke(path);
  };

  /** Points of a curve that stand about `gap` pixels apart. */
  const spaced = (s, range, { px, py }, gap, offset) => {
    const points = [];
    let next = -Infinity;
    for (let i = range[0]; i < range[1]; i += 1) {
      const x = px(s.x[i]), y = py(s.y[i]);
      if (next === -Infinity) next = x + offset;
      if (x >= next && y === y) { points.push([x, y]); next = x + gap; }
    }
    return points;
  };

  const isDrawn = (chart, s) => s.shown && (!s.onHover || chart.isKept || chart.lit !== "");

  const drawSeries = (chart, u, s, place, project, density) => {
    const ctx = u.ctx, range = visible(chart, s, u), isLit = s.onHover && s.name === chart.lit;
    if (s.style === "band") { drawBand(ctx, s, range, project); return; }
    if (s.u !== null) drawErrors(ctx, s, range, project, density);
    if (s.style === "points") {
      const points = [];
      for (let i = range[0]; i < range[1]; i += 1) points.push([project.px(s.x[i]), project.py(s.y[i])]);
      drawMarkers(ctx, s, points.filter(([, y]) => y === y), density);
      return;
    }
    const path = new Path2D();
    if (chart.isPlane) traceLoop(path, s, project); else traceSorted(path, s, s.y, range, project);
    ctx.strokeStyle = isLit ? colour("--text") : inkOf(s);
    ctx.lineWidth = (isLit ? 2 : 1) * s.width * 1.25 * density;
    ctx.lineJoin = "round";
    ctx.setLineDash(s.dash.map((d) => d * density));
    ctx.stroke(path);
    // Several curves of one role differ in colour only; markers along them survive a grey print.
    if (s.isMarked && !chart.isPlane) drawMarkers(ctx, s, spaced(s, range, project, ALONG_LINE_PX * density, 20 * place * density), density * 0.9);
  };

  /** Where the frame lies that a gallery of the chart's group shows. */
  const drawFrame = (chart, u, project, density) => {
    const { ctx, bbox } = u, at = project.px(chart.frameAt), wide = 5 * density;
    if (!(chart.frameAt >= u.scales.x.min && chart.frameAt <= u.scales.x.max)) return;
    ctx.strokeStyle = ctx.fillStyle = colour("--accent"); ctx.lineWidth = 1.5 * density; ctx.setLineDash([]);
    ctx.beginPath(); ctx.moveTo(at, bbox.top); ctx.lineTo(at, bbox.top + bbox.height); ctx.stroke();
    ctx.beginPath(); ctx.moveTo(at - wide, bbox.top); ctx.lineTo(at + wide, bbox.top); ctx.lineTo(at, bbox.top + 1.6 * wide); ctx.fill();
  };

  const drawPositions = (chart, u, project, density) => {
    const { ctx, bbox } = u, inside = chart.description.lines.filter(([, x]) => x >= u.scales.x.min && x <= u.scales.x.max);
    ctx.strokeStyle = colour("--axis"); ctx.globalAlpha = 0.7; ctx.lineWidth = density; ctx.setLineDash([density, 3 * density]);
    ctx.fillStyle = colour("--muted"); ctx.font = `${11 * density}px ${getComputedStyle(document.body).fontFamily}`; ctx.textBaseline = "top"; ctx.textAlign = "left";
    let free = -Infinity, below = -Infinity, last = -Infinity;
    for (const [name, x] of inside) {
      const at = project.px(x), width = ctx.measureText(name).width;
      // A crowd of lines would be a grey block; it comes apart when it is zoomed into.
      if (at - last < CROWDED_PX * density) continue;
      last = at;
      ctx.beginPath(); ctx.moveTo(at, bbox.top); ctx.lineTo(at, bbox.top + bbox.height); ctx.stroke();
      if (at + width + 6 * density >= bbox.left + bbox.width) continue;
      if (at > free) { ctx.fillText(name, at + 4 * density, bbox.top + 3 * density); free = at + width + 10 * density; }
      else if (at > below) { ctx.fillText(name, at + 4 * density, bbox.top + 16 * density); below = at + width + 10 * density; }
    }
    ctx.globalAlpha = 1;
  };

  /** Names of the curves of a family at their ends, beside them where another stands, left out where many do. */
  const drawLabels = (chart, u, project, density) => {
    const { ctx, bbox } = u, taken = [];
    const family = chart.series.filter((s) => s.isLabelled && s.shown && s.role !== "model");
    ctx.font = `${11 * density}px ${getComputedStyle(document.body).fontFamily}`; ctx.textAlign = "right"; ctx.textBaseline = "bottom";
    // Both ends of the scale first: they say where it begins and where it ends.
    const order = family.map((s, i) => [i === 0 || i === family.length - 1 ? 0 : 1, i, s]).sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    for (const [, , s] of order) {
      const [first, last] = visible(chart, s, u);
      let i = last - 1;
      // The end of a loop is its right tip.
      if (chart.isPlane) for (let at = first; at < last; at += 1) if (s.x[at] > s.x[i] && s.y[at] === s.y[at]) i = at;
      while (i >= first && !(project.px(s.x[i]) <= bbox.left + bbox.width && s.y[i] === s.y[i])) i -= 1;
      if (i < first) continue;
      const width = ctx.measureText(s.name).width, height = 12 * density;
      const right = Math.max(project.px(s.x[i]), bbox.left + width), bottom = Math.max(project.py(s.y[i]) - 4 * density, bbox.top + height);
      const boxAt = (lines) => [right - width, bottom + (lines - 1) * height, right, bottom + lines * height];
      const isFree = ([a, b, c, d]) => b >= bbox.top && d <= bbox.top + bbox.height && !taken.some((t) => a < t[2] && t[0] < c && b < t[3] && t[1] < d);
      const box = [0, -1, 1, -2, 2].map(boxAt).find(isFree);
      if (box === undefined) continue;
      taken.push(box);
      ctx.lineWidth = 3 * density; ctx.setLineDash([]); ctx.lineJoin = "round"; ctx.strokeStyle = colour("--page");
      ctx.strokeText(s.name, right, box[3]);
      ctx.fillStyle = inkOf(s);
      ctx.fillText(s.name, right, box[3]);
    }
  };

  const draw = (chart, u) => {
    const { ctx, bbox } = u, density = window.devicePixelRatio || 1;
    const project = projection(u, chart.description);
    ctx.save();
    ctx.beginPath(); ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height); ctx.clip();
    const zero = project.py(0);
    if (chart.hasResidual && Number.isFinite(zero)) {
      ctx.strokeStyle = colour("--axis"); ctx.lineWidth = density; ctx.setLineDash([]);
      ctx.beginPath(); ctx.moveTo(bbox.left, zero); ctx.lineTo(bbox.left + bbox.width, zero); ctx.stroke();
    }
    drawPositions(chart, u, project, density);
    drawFrame(chart, u, project, density);
    const isPoint = (s) => s.style === "points";
    const last = (s) => (isPoint(s) ? 2 : Number(s.onHover && s.name === chart.lit));
    const drawn = chart.series.map((s, place) => [s, place]).filter(([s]) => isDrawn(chart, s));
    drawn.sort(([a, i], [b, j]) => last(a) - last(b) || i - j);
    for (const [s, place] of drawn) drawSeries(chart, u, s, place, project, density);
    drawLabels(chart, u, project, density);
    ctx.restore();
  };

  // ---- windows ----------------------------------------------------------------------------
  const companions = (chart) => (chart.description.group === "" ? [chart] : charts.filter((c) => c.description.group === chart.description.group));

  const groupRange = (chart) => {
    const ranges = companions(chart).map((c) => c.description.range);
    return [Math.min(...ranges.map((r) => r[0])), Math.max(...ranges.map((r) => r[1]))];
  };

  const apply = (chart) => {
    const u = chart.plot;
    for (const button of chart.buttons) button.setAttribute("aria-pressed", String(isCurrent(chart, Number(button.dataset.view))));
    if (chart.slider !== null) {
      const present = chart.buttons.find((button) => button.getAttribute("aria-pressed") === "true");
      if (present !== undefined) chart.slider.value = String(Number(present.dataset.view) + 1);
      chart.slider.setAttribute("aria-valuetext", present?.textContent ?? "between two views");
    }
    if (u === null) return;
    const [x0, x1] = chart.window, [y0, y1] = chart.yWindow ?? heights(chart, chart.window);
    u.batch(() => {
      u.setScale("x", { min: x0, max: x1 });
      u.setScale("y", { min: y0, max: y1 });
    });
    chart.figure.dataset.window = chart.window.join(" ");
  };

  const isCurrent = (chart, view) => {
    const [a, b] = view < 0 ? groupRange(chart) : chart.description.views[view];
    const near = (b - a) * 1e-6;
    return chart.yWindow === null && Math.abs(chart.window[0] - a) <= near && Math.abs(chart.window[1] - b) <= near;
  };

  const setWindow = (chart, from, to) => {
    const scale = chart.description.xScale, f = forward(scale), g = backward(scale);
    const [low, high] = groupRange(chart).map(f), whole = high - low;
    let [a, b] = [f(from), f(to)];
    const width = Math.min(Math.max(b - a, whole * SMALLEST_WINDOW), whole);
    if (!(width > 0)) return;
    a = Math.min(Math.max(a, low), high - width);
    for (const other of companions(chart)) { other.window = [g(a), g(a + width)]; apply(other); }
  };

  /** Zoom about a point given as a fraction of the window. */
  const zoom = (chart, factor, share, yShare) => {
    const scaled = ([from, to], scale, at) => {
      const f = forward(scale), g = backward(scale), a = f(from), b = f(to), centre = a + (b - a) * at;
      return [g(centre - (centre - a) / factor), g(centre + (b - centre) / factor)];
    };
    const next = scaled(chart.window, chart.description.xScale, share);
    if (chart.isPlane) chart.yWindow = scaled(chart.yWindow ?? heights(chart, chart.window), chart.description.yScale, yShare);
    setWindow(chart, ...next);
  };

  const pan = (chart, share) => {
    const f = forward(chart.description.xScale), g = backward(chart.description.xScale);
    const [a, b] = chart.window.map(f), by = (b - a) * share;
    setWindow(chart, g(a + by), g(b + by));
  };

  const reset = (chart) => {
    for (const other of companions(chart)) other.yWindow = null;
    setWindow(chart, ...groupRange(chart));
  };

  // ---- hovering ---------------------------------------------------------------------------
  const nearestAlong = (s, x) => {
    const i = lowerBound(s.x, x);
    if (i === 0) return 0;
    if (i === s.x.length) return i - 1;
    return x - s.x[i - 1] <= s.x[i] - x ? i - 1 : i;
  };

  const nearestInPlane = (chart, s, left, top) => {
    const u = chart.plot;
    let best = -1, smallest = 30 * 30;
    for (let i = 0; i < s.x.length; i += 1) {
      const dx = u.valToPos(s.x[i], "x") - left, dy = u.valToPos(s.y[i], "y") - top;
      if (dx * dx + dy * dy < smallest) { smallest = dx * dx + dy * dy; best = i; }
    }
    return best;
  };

  const widthOf = (u, key) => Math.abs(u.scales[key].max - u.scales[key].min);

  /** The curve of some that passes nearest to the pointer; undefined where there is none. */
  const nearest = (chart, among) => {
    const u = chart.plot, { left, top } = u.cursor;
    if (!(left >= 0)) return undefined;
    let best = undefined, smallest = Infinity;
    for (const s of among) {
      if (!s.shown) continue;
      const i = chart.isPlane ? nearestInPlane(chart, s, left, top) : nearestAlong(s, u.posToVal(left, "x"));
      const dx = chart.isPlane && i >= 0 ? u.valToPos(s.x[i], "x") - left : 0;
      const away = i < 0 ? Infinity : Math.hypot(u.valToPos((s.y ?? s.high)[i], "y") - top, dx);
      if (away < smallest) { smallest = away; best = s; }
    }
    return best;
  };

  /** Light the same repeat in all charts of the group; drawn once per frame and only on change. */
  const light = () => {
    if (isRedrawDue || pointed === null) return;
    isRedrawDue = true;
    requestAnimationFrame(() => {
      isRedrawDue = false;
      const name = pointed.chosen !== "" && pointed.plot.cursor.left >= 0 ? pointed.chosen : nearest(pointed, pointed.series.filter((s) => s.onHover))?.name ?? "";
      for (const chart of companions(pointed)) {
        if (chart.plot === null || chart.lit === name) continue;
        chart.lit = name;
        chart.plot.redraw(false, false);
        hover(chart);
      }
    });
  };

  /** Where a series is read: a line or band between its points as it is drawn, so that curves of different x can be subtracted; all else at point i. */
  const placeOn = (chart, s, i, x) => {
    const next = lowerBound(s.x, x);
    const isBetween = !chart.isPlane && (s.style === "line" || s.style === "band") && next > 0 && next < s.x.length;
    if (!isBetween) return { along: s.x[i], of: (values) => values[i] };
    const f = forward(chart.description.xScale), height = chart.description.yScale;
    const share = (f(x) - f(s.x[next - 1])) / (f(s.x[next]) - f(s.x[next - 1]));
    const between = (values, scale) => backward(scale)((1 - share) * forward(scale)(values[next - 1]) + share * forward(scale)(values[next]));
    return { along: x, of: (values) => between(values, values === s.u ? "linear" : height) };
  };

  const hoverOne = (chart, s, left, top, near) => {
    const u = chart.plot;
    if ((s.onHover && s.name !== chart.lit) || (s.isLabelled && !near.includes(s))) { s.mark.style.display = "none"; return; }
    const i = chart.isPlane ? nearestInPlane(chart, s, left, top) : nearestAlong(s, u.posToVal(left, "x"));
    if (i < 0 || s.x.length === 0 || !s.shown) { s.value.textContent = ""; s.mark.style.display = "none"; return; }
    const say = (v) => readout(v, widthOf(u, "y"));
    const { along, of } = placeOn(chart, s, i, u.posToVal(left, "x"));
    const whose = s.onHover || s.isLabelled ? `${s.name}: ` : "";
    if (s.low !== null) { s.value.textContent = `${whose}${say(of(s.low))} … ${say(of(s.high))}`; return; }
    const value = of(s.y), spread = s.u === null ? NaN : of(s.u);
    const error = spread === spread ? ` ± ${say(spread)}` : "";
    s.value.textContent = whose + (chart.isPlane ? `(${readout(along, widthOf(u, "x"))}, ${say(value)})` : say(value)) + error;
    const x = u.valToPos(along, "x"), y = u.valToPos(value, "y");
    const isInside = x >= 0 && x <= u.over.clientWidth && y >= 0 && y <= u.over.clientHeight;
    s.mark.style.display = isInside ? "block" : "none";
    s.mark.style.background = inkOf(s);
    s.mark.style.transform = `translate(${x}px, ${y}px)`;
  };

  const hover = (chart) => {
    const { left, top } = chart.plot.cursor;
    const isAway = left === null || left === undefined || left < 0;
    const along = chart.plot.posToVal(left, "x"), isDay = chart.description.xScale === "day";
    chart.flag.textContent = isAway || chart.isPlane ? "" : isDay ? dayText(Math.round(along)) : readout(along, widthOf(chart.plot, "x"));
    chart.flag.style.transform = `translateX(calc(${left}px - 50%))`;
    const near = isAway ? [] : families(chart).map((family) => nearest(chart, family));
    for (const s of chart.series) {
      if (isAway) { s.value.textContent = ""; s.mark.style.display = "none"; } else hoverOne(chart, s, left, top, near);
    }
    if (chart === pointed) light();
  };

  // ---- building ---------------------------------------------------------------------------
  const svg = (name, attributes) => {
    const element = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, String(value));
    return element;
  };

  const swatch = (s) => {
    const box = svg("svg", { width: 30, height: 12, viewBox: "0 0 30 12", "aria-hidden": "true" });
    const ink = inkOf(s);
    if (s.style === "band") box.append(svg("rect", { x: 0, y: 1, width: 30, height: 10, fill: ink, opacity: dark.matches ? 0.4 : 0.25 }));
    else if (s.style !== "points") box.append(svg("line", { x1: 0, y1: 6, x2: 30, y2: 6, stroke: ink, "stroke-width": s.width * 1.4, "stroke-dasharray": s.dash.join(" ") }));
    if (s.style === "points" || (s.isMarked && s.style !== "band")) {
      const shapes = { circle: "M19,6a4,4 0 1,1 -8,0a4,4 0 1,1 8,0z", square: "M11.5,2.5h7v7h-7z", triangle: "M15,1.5l4.5,8.3h-9z", diamond: "M15,1l5,5l-5,5l-5,-5z" };
      box.append(svg("path", { d: shapes[s.marker], fill: s.filled ? ink : colour("--page"), stroke: ink, "stroke-width": 1.3 }));
    }
    return box;
  };

  /** One entry of a legend: a button that turns something on and off. */
  const entry = (chart, s, text, isOn, turn) => {
    const button = document.createElement("button"), name = document.createElement("span");
    const value = document.createElement("span");
    value.className = s.style === "band" || s.onHover || s.isLabelled || chart.isPlane ? "value value-wide" : "value";
    name.textContent = text;
    button.type = "button";
    button.setAttribute("aria-pressed", String(isOn()));
    button.append(swatch(s), name, value);
    button.addEventListener("click", () => {
      turn();
      button.setAttribute("aria-pressed", String(isOn()));
      apply(chart);
      chart.plot.redraw();
    });
    chart.figure.querySelector(".chart-legend").append(button);
    return value;
  };

  /** Curves on a scale of colours, by their role. */
  const families = (chart) => {
    const groups = new Map();
    for (const s of chart.series.filter((one) => one.isLabelled)) groups.set(s.role + s.style, [...(groups.get(s.role + s.style) ?? []), s]);
    return [...groups.values()];
  };

  const buildLegend = (chart) => {
    chart.figure.querySelector(".chart-legend").replaceChildren();
    const crowd = chart.series.filter((s) => s.onHover);
    // A family is a scale of colours with a name at each of its curves: one entry stands for all of a role.
    for (const family of families(chart)) {
      const [first, last] = [family[0].name, family.at(-1).name], comma = first.indexOf(", ");
      const tail = comma > 0 && family.every((s) => s.name.endsWith(first.slice(comma))) ? first.slice(comma) : "";
      const bare = (name) => name.slice(0, name.length - tail.length);
      const ends = family.length > 1 ? `${bare(first)} to ${bare(last)}${tail} (blue to red), ${family.length} curves` : first;
      const value = entry(chart, family.at(-1), ends, () => family[0].shown, () => { for (const s of family) s.shown = !s.shown; });
      for (const s of family) s.value = value;
    }
    for (const s of chart.series) {
      if (s.onHover || s.isLabelled) continue;
      s.value = entry(chart, s, s.name, () => s.shown, () => { s.shown = !s.shown; });
    }
    if (crowd.length === 0) return;
    const value = entry(chart, crowd[0], `${crowd.length} single curves, where you point`, () => chart.isKept, () => { chart.isKept = !chart.isKept; });
    value.parentElement.classList.add("crowd");
    value.parentElement.title = "select to keep them in view";
    for (const s of crowd) s.value = value;
  };

  const buildMarks = (chart) => {
    for (const s of chart.series) {
      s.mark = document.createElement("div");
      s.mark.className = "hover-mark";
      chart.plot.over.append(s.mark);
    }
    chart.flag = document.createElement("div");
    chart.flag.className = "x-flag";
    chart.plot.over.append(chart.flag);
  };

  const axis = (chart, key) => {
    const isX = key === "x", scale = chart.description[isX ? "xScale" : "yScale"];
    const family = getComputedStyle(document.body).fontFamily;
    const options = {
      scale: key, label: isX ? chart.description.xLabel : undefined, font: `12px ${family}`, labelFont: `13px ${family}`, labelGap: 2,
      labelSize: 22, gap: 5, space: isX ? (scale === "day" ? 96 : 64) : 36, stroke: () => colour("--text"),
      grid: { stroke: () => colour("--grid"), width: 1 }, ticks: { stroke: () => colour("--axis"), width: 1, size: 5 }, border: { show: true, stroke: () => colour("--axis"), width: 1 },
      values: (u, ticks, place, space, step) => (scale === "log" ? logLabels(ticks, isX ? (u.width - 80) / 40 : u.height / 22) : ticks.map((v) => (scale === "day" ? dayText(v) : tickText(v, step)))),
      size: (u, values) => {
        if (isX) return 28;
        u.ctx.save(); u.ctx.font = `${12 * (window.devicePixelRatio || 1)}px ${family}`;
        const widest = Math.max(...(values ?? []).map((v) => u.ctx.measureText(v ?? "").width), 0) / (window.devicePixelRatio || 1);
        u.ctx.restore();
        // One width for most charts, so that the frames of a group stand under each other.
        return Math.max(Math.ceil(widest) + 14, chart.description.group === "" ? 46 : 66);
      },
    };
    if (scale === "log") { options.splits = (u, place, low, high) => logTicks(low, high); options.filter = (u, ticks) => ticks; }
    return options;
  };

  const select = (chart, u) => {
    const { left, top, width, height } = u.select;
    u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    if (width < 4 || (chart.isPlane && height < 4)) return;
    const from = u.posToVal(left, "x"), to = u.posToVal(left + width, "x");
    if (chart.isPlane) chart.yWindow = [u.posToVal(top + height, "y"), u.posToVal(top, "y")];
    setWindow(chart, from, to);
  };

  const build = (chart) => {
    const d = chart.description, host = chart.figure.querySelector(".chart-plot");
    const [y0, y1] = heights(chart, chart.window);
    chart.plot = new uPlot({
      width: host.clientWidth, height: d.height, padding: [8, 14, 0, 0], legend: { show: false },
      scales: {
        // Without a range of our own uPlot widens logarithmic axes to whole decades.
        x: { time: false, auto: false, distr: d.xScale === "log" ? 3 : 1, min: chart.window[0], max: chart.window[1], range: (u, min, max) => [min, max] },
        y: { auto: false, distr: d.yScale === "log" ? 3 : 1, min: y0, max: y1, range: (u, min, max) => [min, max] },
      },
      axes: [axis(chart, "x"), axis(chart, "y")],
      series: [{}, { scale: "y", paths: () => null, points: { show: false } }],
      cursor: {
        x: true, y: chart.isPlane, points: { show: false }, drag: { x: true, y: chart.isPlane, setScale: false, uni: null },
        bind: { dblclick: () => () => reset(chart) },
        ...(d.group === "" ? {} : { sync: { key: `group ${d.group}`, setSeries: false, scales: ["x", null], filters: { pub: (type) => type === "mousemove" || type === "mouseleave" } } }),
      },
      hooks: { draw: [(u) => draw(chart, u)], setCursor: [() => hover(chart)], setSelect: [(u) => select(chart, u)] },
    }, [[chart.window[0], chart.window[1]], [null, null]], host);
    buildMarks(chart);
    for (const kind of ["mousemove", "mouseenter"]) chart.plot.over.addEventListener(kind, () => { pointed = chart; });
    apply(chart);
  };

  /** Show a window that the page offers as a button; -1 is the whole range. */
  const show = (chart, view) => {
    if (view < 0) { reset(chart); return; }
    chart.yWindow = null;
    setWindow(chart, ...chart.description.views[view]);
  };

  /** The view a key asks for: 0 all, 1 to 9 by number, [ and ] the one before and after. */
  const viewOf = (chart, key) => {
    const count = (chart.description.views ?? []).length;
    if (/^[0-9]$/.test(key)) return Number(key) <= count ? Number(key) - 1 : null;
    if (count === 0 || (key !== "[" && key !== "]")) return null;
    const present = chart.buttons.findIndex((b) => b.getAttribute("aria-pressed") === "true") - 1;
    return Math.min(Math.max(Math.max(present, -1) + (key === "]" ? 1 : -1), -1), count - 1);
  };

  /** Light one curve after the other; after the last one the nearest is lit again. */
  const chooseNext = (chart, move) => {
    const names = ["", ...chart.series.filter((s) => s.onHover).map((s) => s.name)];
    const next = names[(names.indexOf(chart.chosen) + 1) % names.length];
    for (const other of companions(chart)) other.chosen = next;
    move(0);
  };

  /** The window between two views: 0 is the whole range, 1 the first view; zoomed evenly between. */
  const between = (chart, place) => {
    const f = forward(chart.description.xScale), g = backward(chart.description.xScale);
    const ends = (view) => (view < 0 ? groupRange(chart) : chart.description.views[view]).map(f);
    const first = Math.floor(place), share = place - first;
    const [a0, a1] = ends(first - 1);
    if (share === 0) return [g(a0), g(a1)];
    const [b0, b1] = ends(first), wide = a1 - a0, narrow = b1 - b0;
    const width = wide ** (1 - share) * narrow ** share;
    const moved = Math.abs(wide - narrow) > 1e-9 * wide ? (wide - width) / (wide - narrow) : share;
    const centre = (a0 + a1) / 2 + ((b0 + b1 - a0 - a1) / 2) * moved;
    return [g(centre - width / 2), g(centre + width / 2)];
  };

  /** A slider from the whole range through the views, on the first chart of a group. */
  const buildSlider = (chart) => {
    const count = chart.description.views?.length ?? 0;
    if (count < 2 || companions(chart)[0] !== chart) return;
    const slider = document.createElement("input");
    Object.assign(slider, { type: "range", min: "0", max: String(count), step: "0.01", value: "0", className: "view-slider" });
    slider.setAttribute("aria-label", `From the whole range through: ${chart.buttons.slice(1).map((b) => b.textContent).join(", ")}`);
    slider.addEventListener("input", () => { chart.yWindow = null; setWindow(chart, ...between(chart, Number(slider.value))); });
    slider.addEventListener("change", () => show(chart, Math.round(Number(slider.value)) - 1));
    slider.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowUp: 1, PageUp: 1, ArrowLeft: -1, ArrowDown: -1, PageDown: -1, Home: -count, End: count }[event.key];
      if (step === undefined) return;
      event.preventDefault();
      show(chart, Math.min(Math.max(Math.round(Number(slider.value)) + step, 0), count) - 1);
    });
    chart.figure.querySelector(".chart-views").append(slider);
    chart.slider = slider;
  };

  const onKey = (chart, event) => {
    const u = chart.plot;
    if (event.target !== event.currentTarget || event.ctrlKey || event.metaKey || event.altKey || u === null) return;
    const actions = {
      ArrowLeft: () => pan(chart, -PAN_SHARE), ArrowRight: () => pan(chart, PAN_SHARE),
      ArrowUp: () => zoom(chart, KEY_ZOOM, 0.5, 0.5), "+": () => zoom(chart, KEY_ZOOM, 0.5, 0.5),
      ArrowDown: () => zoom(chart, 1 / KEY_ZOOM, 0.5, 0.5), "-": () => zoom(chart, 1 / KEY_ZOOM, 0.5, 0.5),
      Home: () => reset(chart), Escape: () => reset(chart),
    };
    pointed = chart;
    const move = (by) => u.setCursor({ left: Math.min(Math.max((u.cursor.left >= 0 ? u.cursor.left : u.over.clientWidth / 2) + by, 0), u.over.clientWidth), top: u.over.clientHeight / 2 });
    const view = viewOf(chart, event.key);
    if (view !== null) actions[event.key] = () => show(chart, view);
    if (event.key === "r" && chart.series.some((s) => s.onHover)) actions.r = () => chooseNext(chart, move);
    const action = event.shiftKey && event.key === "ArrowLeft" ? () => move(-CURSOR_STEP_PX) : event.shiftKey && event.key === "ArrowRight" ? () => move(CURSOR_STEP_PX) : actions[event.key];
    if (action === undefined) return;
    event.preventDefault();
    action();
  };

  const onWheel = (chart, event) => {
    // An unfocused chart lets the page scroll; a click or Ctrl (a pinch on a touchpad) takes over.
    if (chart.plot === null || !(event.ctrlKey || chart.figure.contains(document.activeElement))) return;
    event.preventDefault();
    const box = chart.plot.over.getBoundingClientRect(), unit = event.deltaMode === 1 ? 16 : 1;
    if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) { pan(chart, (event.deltaX * unit) / box.width); return; }
    const share = (event.clientX - box.left) / box.width, yShare = 1 - (event.clientY - box.top) / box.height;
    zoom(chart, WHEEL_ZOOM ** (-event.deltaY * unit), Math.min(Math.max(share, 0), 1), Math.min(Math.max(yShare, 0), 1));
  };

  const prepare = (figure) => {
    const description = JSON.parse(figure.querySelector('script[type="application/json"]').textContent);
    const series = decode(description);
    const chart = { figure, description, series, plot: null, flag: null, window: description.range, yWindow: null, isPlane: description.kind === "plane", hasResidual: series.some((s) => s.role === "residual"), buttons: [...figure.querySelectorAll(".view")], slider: null, frameAt: NaN, lit: "", chosen: "", isKept: false };
    const live = figure.querySelector(".chart-live"), host = figure.querySelector(".chart-plot");
    host.style.height = `${description.height}px`;
    figure.querySelector(".chart-y-label").textContent = description.yLabel;
    charts.push(chart);
    buildLegend(chart);
    for (const button of chart.buttons) {
      button.addEventListener("click", () => show(chart, Number(button.dataset.view)));
    }
    live.addEventListener("keydown", (event) => onKey(chart, event));
    host.addEventListener("wheel", (event) => onWheel(chart, event), { passive: false });
    host.addEventListener("mousedown", () => live.focus({ preventScroll: true }));
    // A chart inside something folded has no width until it is unfolded.
    new ResizeObserver(() => {
      if (host.clientWidth < 40) return;
      if (chart.plot === null) build(chart);
      else if (chart.plot.width !== host.clientWidth) { chart.plot.setSize({ width: host.clientWidth, height: description.height }); apply(chart); }
    }).observe(host);
  };

  for (const figure of document.querySelectorAll("figure.chart")) {
    figure.classList.add("is-live");
    try {
      prepare(figure);
    } catch (problem) {
      figure.classList.remove("is-live");
      console.error("this chart is shown as a still picture", problem);
    }
  }
  // Companions are known only now.
  for (const chart of charts) { chart.window = groupRange(chart); buildSlider(chart); apply(chart); }
  for (const chart of charts) if (chart.description.opensOnView) show(chart, 0);
  /** Mark the frame that a gallery shows; a gallery without a place or a group marks nothing. */
  const markFrame = (gallery) => {
    const { group, at } = gallery.dataset;
    for (const chart of charts) {
      if (group === "" || chart.description.group !== group) continue;
      chart.frameAt = at === "" ? NaN : Number(at);
      if (chart.plot !== null) chart.plot.redraw(false, false);
    }
  };
  document.addEventListener("frame", (event) => markFrame(event.target));
  for (const gallery of document.querySelectorAll(".gallery")) markFrame(gallery);
  dark.addEventListener("change", () => {
    for (const chart of charts) { buildLegend(chart); if (chart.plot !== null) chart.plot.redraw(); }
  });
})();
