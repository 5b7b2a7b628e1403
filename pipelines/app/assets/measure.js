"use strict";
// Click to measure: two places give a scale, a drag the line of subsets or the rigid subset.

const stage = { name: "", index: 0, image: null, frames: 1, points: [], cursor: [0, 0], result: null, from: null, before: [] };
const TOOLS = {
  scale: "Scale: click on two edges or graduations, or drag from one to the other",
  line: "Line of subsets: drag, or set both ends",
  body: "Rigid subset: drag from its centre to its border, or set both",
  region: "Region that counts, of the contact or the holder: drag from corner to corner, or set both",
  cover: "Mask that moves with the holder, within which nothing counts: drag from corner to corner, or set both",
  obstruction: "Obstruction, which stands still before the holder: drag from corner to corner, or set both",
};
const MASKS = { region: "regions", cover: "covers", obstruction: "obstructions" };

function drawMeasure() {
  const part = by("measure");
  if (part.childElementCount) return;
  const file = make("select", { id: "measure-file" });
  const tool = make("select", { id: "measure-tool" }, ...Object.entries(TOOLS).map(([value, textContent]) => make("option", { value, textContent })));
  const zoom = make("select", { id: "measure-zoom" }, ...[["fit", "whole"], ["1", "1:1"], ["2", "2:1"], ["4", "4:1"]].map(([value, textContent]) => make("option", { value, textContent })));
  const index = make("input", { id: "measure-index", type: "number", min: 0, value: 0 });
  const canvas = make("canvas", { id: "measure-canvas", tabIndex: 0 });
  canvas.setAttribute("role", "application");
  canvas.setAttribute("aria-label", "Picture: arrow keys move the cross, Shift ten times as far, Enter sets a place, Escape begins again");
  part.append(
    make("div", { className: "bar" }, make("label", {}, "File ", file), make("label", { id: "measure-frame", hidden: true }, "Frame ", index), make("label", {}, "Tool ", tool), make("label", {}, "Zoom ", zoom)),
    make("div", { id: "stage" }, canvas), make("p", { id: "measure-result", className: "note" }), make("div", { className: "bar", id: "measure-use" }));
  file.addEventListener("change", () => go(`measure/${file.value}`));
  index.addEventListener("change", trying(() => loadPicture(stage.name, Math.max(0, Math.floor(Number(index.value) || 0)))));
  tool.addEventListener("change", begin);
  zoom.addEventListener("change", paint);
  // The canvas keeps the pointer, so that a drag ends where it is let go, also beyond the border.
  const isDrag = (end) => Math.hypot(end[0] - stage.from[0], end[1] - stage.from[1]) * scale() > 6;
  canvas.addEventListener("pointerdown", (event) => {
    if (!event.isPrimary || event.button !== 0) return;
    canvas.setPointerCapture(event.pointerId);
    Object.assign(stage, { from: placeOf(event), before: stage.points });
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!stage.from || !isDrag(placeOf(event))) return;
    Object.assign(stage, { points: [stage.from, placeOf(event)], result: null });
    paint();
  });
  canvas.addEventListener("pointercancel", () => {
    if (stage.from) Object.assign(stage, { from: null, points: stage.before });
    paint();
  });
  canvas.addEventListener("pointerup", trying(async (event) => {
    if (!stage.from) return;
    const end = placeOf(event);
    const [start, isDragged] = [stage.from, isDrag(end)];
    stage.from = null;
    if (isDragged) stage.points = [start];
    await place(isDragged ? end : start);
  }));
  canvas.addEventListener("keydown", trying(async (event) => {
    const step = event.shiftKey ? 10 : 1;
    const moves = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] };
    if (moves[event.key]) {
      stage.cursor = stage.cursor.map((value, axis) => Math.min(Math.max(0, value + moves[event.key][axis]), (axis ? canvas.height : canvas.width) / scale() - 1));
      paint();
    } else if (event.key === "Enter") await place([...stage.cursor]);
    else if (event.key === "Escape") begin();
    else return;
    event.preventDefault();
  }));
}

const scale = () => {
  const chosen = by("measure-zoom").value;
  if (chosen !== "fit") return Number(chosen);
  return stage.image ? Math.min(1, (by("stage").clientWidth - 2) / stage.image.naturalWidth) : 1;
};

function placeOf(event) {
  const box = by("measure-canvas").getBoundingClientRect();
  // The centre of the first pixel is (0, 0); beyond the border the nearest pixel counts.
  const inside = (value, pixels) => Math.min(Math.max(0, value / scale() - 0.5), pixels / scale() - 1);
  return [inside(event.clientX - box.left, box.width), inside(event.clientY - box.top, box.height)];
}

function paint() {
  const canvas = by("measure-canvas");
  if (!stage.image) return;
  const s = scale();
  canvas.width = Math.round(stage.image.naturalWidth * s);
  canvas.height = Math.round(stage.image.naturalHeight * s);
  const pen = canvas.getContext("2d");
  pen.imageSmoothingEnabled = s < 1;
  pen.drawImage(stage.image, 0, 0, canvas.width, canvas.height);
  const cross = ([x, y], colour, size) => {
    const [a, b] = [(x + 0.5) * s, (y + 0.5) * s];
    for (const [width, style] of [[3, "#000"], [1.5, colour]]) {
      pen.lineWidth = width;
      pen.strokeStyle = style;
      pen.beginPath();
      pen.moveTo(a - size, b);
      pen.lineTo(a + size, b);
      pen.moveTo(a, b - size);
      pen.lineTo(a, b + size);
      pen.stroke();
    }
  };
  const points = stage.result && stage.result.points ? stage.result.points : stage.points;
  if (points.length === 2) {
    pen.strokeStyle = "#ffd400";
    pen.lineWidth = 1.5;
    const [[x1, y1], [x2, y2]] = points.map(([x, y]) => [(x + 0.5) * s, (y + 0.5) * s]);
    pen.beginPath();
    if (by("measure-tool").value === "body") {
      const half = Math.max(Math.abs(x2 - x1), Math.abs(y2 - y1));
      pen.rect(x1 - half, y1 - half, 2 * half, 2 * half);
    } else if (MASKS[by("measure-tool").value]) {
      pen.rect(Math.min(x1, x2), Math.min(y1, y2), Math.abs(x2 - x1), Math.abs(y2 - y1));
    } else {
      pen.moveTo(x1, y1);
      pen.lineTo(x2, y2);
    }
    pen.stroke();
  }
  points.forEach((point) => cross(point, "#ffd400", 9));
  cross(stage.cursor, "#4cf", 14);
}

function begin() {
  Object.assign(stage, { points: [], result: null });
  by("measure-result").textContent = TOOLS[by("measure-tool").value];
  by("measure-use").replaceChildren();
  paint();
}

async function loadPicture(name, index) {
  const image = new Image();
  const found = await ask(`api/image?name=${encodeURIComponent(name)}&index=${index}`);
  image.src = `api/frame?name=${encodeURIComponent(name)}&index=${index}`;
  await image.decode();
  Object.assign(stage, { name, index, image, frames: found.frames, cursor: [Math.floor(image.naturalWidth / 2), Math.floor(image.naturalHeight / 2)] });
  by("measure-frame").hidden = found.frames < 2;
  by("measure-index").max = found.frames - 1;
  by("measure-index").value = index;
  begin();
}

async function measureFile(name) {
  if (!name) return;
  by("measure-file").value = name;
  await loadPicture(name, 0);
}

async function place(point) {
  if (stage.points.length === 2) begin();
  stage.points.push(point);
  if (stage.points.length === 2) await measured();
  paint();
}

async function sessionFor() {
  await views.setup();
}

async function measured() {
  const tool = by("measure-tool").value;
  const use = by("measure-use");
  const [[x1, y1], [x2, y2]] = stage.points;
  if (tool === "scale") {
    try {
      stage.result = await ask("api/length", { name: stage.name, index: stage.index, points: stage.points });
    } catch (error) {
      begin();
      throw error;
    }
    by("measure-result").textContent = `${stage.result.text} between ${stage.result.found.join(" and ")}`;
    await sessionFor();
    const records = setup.data.records.filter((record) => record.kind === "camera");
    const fresh = ["under", "front"].filter((view) => records.every((one) => one.view !== view));
    const record = make("select", { id: "measure-record", ariaLabel: "Record" }, ...records.map((one) => make("option", { value: one.name, textContent: one.name })), ...fresh.map((view) => make("option", { value: view, textContent: `a new record: view ${view}` })));
    const camera = setup.data.experiments.filter(films).flatMap((one) => one.fields).find((field) => field.place.at(-1) === "camera");
    const named = records.find((one) => (camera ? one.name === camera.text : stage.name.toLowerCase().includes(one.view)));
    if (named) record.value = named.name;
    const known = make("input", { id: "measure-length", type: "text", placeholder: "30,00 ± 0,02 mm" });
    const who = make("input", { id: "measure-who", type: "text", value: setup.data.person });
    const how = make("input", { id: "measure-how", type: "text", value: `two clicks on ${stage.name}` });
    use.replaceChildren(make("label", {}, "True length ", known), make("label", {}, "Record ", record), make("label", {}, "By ", who), make("label", {}, "How ", how), button("Use as scale", async () => {
      let file = record.value;
      if (fresh.includes(file)) {
        const own = setup.data.experiments.filter((one) => one.view === file && one.fields.some((field) => field.record === "camera"));
        await restructure({ op: "record", kind: "camera", view: file, names: own.map((one) => one.name) });
        file = setup.data.records.find((one) => one.kind === "camera" && one.view === file).name;
      }
      const set = (place, text) => text && setField({ file, place }, text);
      set(["values", "reference_length"], known.value);
      set(["values", "pixel_length"], stage.result.text);
      setField({ file, place: ["values", "scale"] }, "");
      set(["who"], who.value);
      set(["how"], how.value);
      if (setup.data.records.some((one) => one.name === file && one.fields.some((field) => field.place[0] === "when" && !field.text))) set(["when"], new Date().toISOString().slice(0, 10));
      return taken();
    }));
    known.focus();
    say("");
    return;
  }
  await sessionFor();
  const has = (one, key) => one.fields.some((field) => field.place.length > 2 && field.place.at(-1) === key);
  const key = MASKS[tool] || { line: "line", body: "body" }[tool];
  const able = setup.data.experiments.filter((one) => has(one, key) || (tool === "region" && has(one, "region")));
  const experiment = make("select", { id: "measure-experiment" }, ...able.map((one) => make("option", { value: one.name, textContent: one.name })));
  const own = able.find(films);
  if (own) experiment.value = own.name;
  const round = (value) => Math.round(value * 10) / 10;
  const half = Math.max(Math.abs(x2 - x1), Math.abs(y2 - y1));
  const width = 2 * Math.round(half) + 1;
  const [left, right] = [x1, x2].sort((a, b) => a - b).map(round);
  const [top, bottom] = [y1, y2].sort((a, b) => a - b).map(round);
  by("measure-result").textContent = {
    line: `line from (${round(x1)}, ${round(y1)}) to (${round(x2)}, ${round(y2)})`,
    body: `square of ${width} px around (${round(x1)}, ${round(y1)})`,
  }[tool] || `${tool === "cover" ? "mask" : tool} from (${left}, ${top}) to (${right}, ${bottom})`;
  use.replaceChildren(make("label", {}, "Experiment ", experiment), button("Use for the experiment", () => {
    const one = setup.data.experiments.find((each) => each.name === experiment.value);
    if (!one) throw new Error("No experiment of the session takes this from a film.");
    const set = (name, text) => {
      const field = one.fields.find((each) => each.place.at(-1) === name);
      setField(field, text);
      return field;
    };
    if (tool === "line") set("line", JSON.stringify([[round(x1), round(y1)], [round(x2), round(y2)]]));
    else if (tool === "body") {
      set("body", JSON.stringify([round(x1), round(y1)]));
      set("body_subset", String(width));
    } else if (tool === "region" && has(one, "region")) set("region", JSON.stringify([[left, top], [right, bottom]]));
    else {
      const field = one.fields.find((each) => each.place.at(-1) === key);
      const before = JSON.parse(typed(field) || "[]");
      set(key, JSON.stringify([...before, [[left, top], [right, top], [right, bottom], [left, bottom]]]));
    }
    return taken();
  }));
}

const films = (one) => one.fields.some((field) => field.place.at(-1) === "film" && field.text === stage.name);

async function taken() {
  await check(true);
  go("setup");
  by("setup-write").focus();
}

views.measure = async (name) => {
  drawMeasure();
  await loadFiles();
  const names = files.filter((file) => file.content === "film" || file.content === "picture").map((file) => file.name);
  by("measure-file").replaceChildren(make("option", { value: "", textContent: names.length ? "choose …" : "no film or picture here" }), ...names.map((name) => make("option", { value: name, textContent: name })));
  by("measure-file").value = names.includes(stage.name) ? stage.name : "";
  if (name && name !== stage.name) await measureFile(name);
};
