"use strict";
// Set-up: experiments as cards, one table of specimens, one of calibrations; nothing is written before the difference was seen.

const setup = { base: "", edits: [], data: null, timer: 0, turn: 0 };
const keyOf = (field) => `${field.file}\n${field.place.join(".")}`;

const problemsOf = (field) => setup.data.problems.filter((problem) => problem.file === field.file && problem.place === field.dotted).map((problem) => problem.message);

function typed(field) {
  const edit = setup.edits.findLast((one) => one.op === "set" && one.file === field.file && one.place.join(".") === field.place.join("."));
  return edit ? edit.text : field.text;
}

function setField(field, text) {
  setup.edits = setup.edits.filter((one) => !(one.op === "set" && one.file === field.file && one.place.join(".") === field.place.join(".")));
  setup.edits.push({ op: "set", file: field.file, place: field.place, text });
}

let lists = 0;
function control(field, fields = [field], name = field.label) {
  const values = [...new Set(fields.map(typed))];
  const value = values.length === 1 ? values[0] : "";
  let input;
  const made = [];
  if (field.choices.length) {
    const options = ["", ...field.choices];
    if (value && !options.includes(value)) options.push(value);
    input = make("select", {}, ...options.map((choice) => make("option", { value: choice, textContent: choice || "–" })));
    input.value = value;
  } else {
    input = make("input", { type: "text", value, spellcheck: false, autocomplete: "off", placeholder: values.length > 1 ? "differs" : "" });
    if (field.suggestions.length) {
      const list = make("datalist", { id: `list-${(lists += 1)}` }, ...field.suggestions.map((text) => make("option", { value: text })));
      input.setAttribute("list", list.id);
      made.push(list);
    }
  }
  input.setAttribute("aria-label", name);
  input.title = field.expected;
  input.fields = fields;
  const change = () => {
    for (const one of fields) setField(one, input.value);
    for (const other of document.querySelectorAll("#setup input, #setup select")) {
      if (other !== input && other.fields && other.fields.some((one) => fields.some((two) => keyOf(one) === keyOf(two)))) {
        const now = [...new Set(other.fields.map(typed))];
        other.value = now.length === 1 ? now[0] : "";
      }
    }
    clearTimeout(setup.timer);
    setup.timer = setTimeout(trying(() => check(false)), 250);
  };
  input.addEventListener("input", change);
  return [input, ...made];
}

function mark() {
  const written = new Map([...setup.data.experiments, ...setup.data.records].flatMap((one) => one.fields).map((field) => [keyOf(field), field.text]));
  for (const input of document.querySelectorAll("#setup input, #setup select")) {
    if (!input.fields) continue;
    const problems = [...new Set(input.fields.flatMap(problemsOf))];
    const isGap = problems.length > 0 && input.fields.every((field) => !typed(field));
    input.classList.toggle("is-gap", isGap);
    input.classList.toggle("is-wrong", problems.length > 0 && !isGap);
    input.setAttribute("aria-invalid", problems.length > 0 && !isGap ? "true" : "false");
    if (!input.note) continue;
    const { remark, expected } = input.fields[0];
    const read = written.get(keyOf(input.fields[0])) || "";
    const echo = input.value.trim() && read !== input.value.trim() ? `read as ${read.replace("degC", "°C")}` : "";
    input.note.textContent = isGap ? `needed: ${remark || expected}` : problems.join("; ") || [echo, remark].filter(Boolean).join("; ");
    input.note.className = `note ${isGap ? "is-warning" : problems.length ? "is-error" : ""}`;
  }
  const known = new Set([...document.querySelectorAll("#setup input, #setup select")].flatMap((input) => (input.fields || []).flatMap((field) => problemsOf(field))));
  const others = setup.data.problems.filter((problem) => !known.has(problem.message));
  by("setup-problems").replaceChildren(...others.map((problem) => make("li", { textContent: `${problem.file}:${problem.line}: ${problem.place} ${problem.message}` })));
  const n = setup.data.problems.length;
  const all = setup.data.experiments.length;
  const waiting = setup.data.experiments.filter((one) => one.waits).length;
  by("setup-state").textContent = `${isSession ? "" : "A proposal, not written yet: "}${all} experiment${all === 1 ? "" : "s"}, ${waiting || "none"} of them waiting; ${n} value${n === 1 ? "" : "s"} to fill in or correct`;
  by("setup-write").disabled = by("setup-undo").disabled = !setup.edits.length;
}

const row = (field, name = field.label) => {
  const [input, ...more] = control(field, [field], name);
  input.note = make("p", { className: "note" });
  const made = make("label", { className: "field" }, make("span", { textContent: field.label + (field.required || field.gap ? "" : " (optional)") }), input, ...more, input.note);
  if (!field.record) return made;
  const fresh = button("New record", () => restructure({ op: "record", kind: field.record, view: "", names: [field.place[1]] }));
  fresh.setAttribute("aria-label", `New calibration record for ${field.place[1]}`);
  return make("div", {}, made, fresh);
};

async function restructure(edit) {
  setup.edits.push(edit);
  try {
    await check(true);
  } catch (error) {
    setup.edits.pop();
    throw error;
  }
}

function button(text, work) {
  const made = make("button", { type: "button", textContent: text });
  made.addEventListener("click", trying(work));
  return made;
}

function experiment(one) {
  const lists = one.fields.filter((field) => field.files);
  const above = one.fields.filter((field) => isSpecimen(one, field));
  const needed = one.fields.filter((field) => !field.files && !above.includes(field) && (field.required || field.text || field.gap));
  const further = one.fields.filter((field) => !field.files && !above.includes(field) && !needed.includes(field));
  const name = make("input", { type: "text", value: one.name, spellcheck: false });
  name.setAttribute("aria-label", `Name of ${one.name}`);
  const card = make("li", { dataset: { name: one.name } }, make("h3", {}, name));
  const recordings = one.fields.flatMap((field) => field.files || [field.text]);
  const first = files.find((file) => hasPicture(file) && recordings.includes(file.name));
  if (first) card.append(pictureOf(first));
  const kind = make("select", {}, ...one.kinds.map(([value, textContent]) => make("option", { value, textContent })));
  kind.value = one.kind;
  kind.setAttribute("aria-label", `Kind of ${one.name}`);
  kind.addEventListener("change", trying(() => restructure({ op: "kind", name: one.name, to: kind.value })));
  card.append(one.kinds.length > 1 ? make("p", {}, kind) : make("p", { textContent: one.title }), make("p", { textContent: [one.waits ? "waits" : "", one.why].filter(Boolean).join(" · ") }));
  const boxes = [];
  for (const field of lists) {
    const list = make("ul", { className: "note" });
    for (const file of field.files) {
      const box = make("input", { type: "checkbox", value: file });
      boxes.push([field, box]);
      list.append(make("li", {}, make("label", {}, box, ` ${file}`)));
    }
    card.append(list);
  }
  const bar = make("div", { className: "bar" });
  bar.append(button("Rename", () => restructure({ op: "rename", name: one.name, to: name.value })));
  bar.append(button("Leave out", () => restructure({ op: "remove", name: one.name })));
  if (lists.length && lists[0].files.length > 1) {
    bar.append(button("Split off what is ticked", () => {
      const names = boxes.filter(([field, box]) => field === lists[0] && box.checked).map(([, box]) => box.value);
      return restructure({ op: "split", name: one.name, to: free(`${one.name}_b`), key: lists[0].place.at(-1), names });
    }));
  }
  const others = setup.data.experiments.filter((two) => two.kind === one.kind && two.name !== one.name);
  if (lists.length && others.length) {
    const choice = make("select", {}, make("option", { value: "", textContent: "Merge with …" }), ...others.map((two) => make("option", { value: two.name, textContent: two.name })));
    choice.setAttribute("aria-label", `Merge ${one.name} with`);
    choice.addEventListener("change", trying(() => choice.value && restructure({ op: "merge", name: one.name, other: choice.value, key: lists[0].place.at(-1) })));
    bar.append(choice);
  }
  if (lists.length) {
    // A recording that came later belongs to one of the experiments that hold its like.
    const like = (files.find((file) => file.name === lists[0].files[0]) || {}).kind;
    const taken = setup.data.experiments.flatMap((two) => two.fields.flatMap((field) => field.files || []));
    // A table that no instrument recognises can be read by the columns that this card names.
    const named = one.fields.some((field) => field.place.at(-1) === "columns");
    const fits = (file) => (file.kind ? file.kind === like : named && file.reason.includes("columns = "));
    const new_ = files.filter((file) => fits(file) && !file.copy_of && !taken.includes(file.name));
    if (new_.length && lists[0].files.length) {
      const choice = make("select", {}, make("option", { value: "", textContent: "Add a recording …" }), ...new_.map((file) => make("option", { value: file.name, textContent: file.name })));
      choice.setAttribute("aria-label", `Add a recording to ${one.name}`);
      choice.addEventListener("change", trying(() => choice.value && restructure({ op: "add", name: one.name, key: lists[0].place.at(-1), names: [choice.value] })));
      bar.append(choice);
    }
  }
  card.append(bar, make("div", { className: "fields" }, ...needed.map((field) => row(field))));
  if (above.length) card.append(make("details", {}, make("summary", { textContent: "Its specimen alone" }), make("div", { className: "fields" }, ...above.map((field) => row(field)))));
  if (one.takes_notes) {
    const text = make("input", { type: "text" });
    text.setAttribute("aria-label", `Note on ${one.name}`);
    card.append(make("div", { className: "bar" }, text, button("Add a note of today", () => text.value.trim() && restructure({ op: "note", name: one.name, who: setup.data.person, text: text.value }))));
  }
  if (further.length) card.append(make("details", {}, make("summary", { textContent: "More settings" }), make("div", { className: "fields" }, ...further.map((field) => row(field)))));
  return card;
}

function free(name) {
  const taken = setup.data.experiments.map((one) => one.name);
  let number = 2;
  let wanted = name;
  while (taken.includes(wanted)) wanted = `${name}${number++}`;
  return wanted;
}

// A table of an experiment that names a material is a specimen; what is asked of it, and how it is called.
const SPECIMEN = { material: "material", material_from: "or its DMA", radius: "radius", mass: "mass", thickness: "thickness", temperature: "temperature" };
const isSpecimen = (one, field) => field.place.length === 4 && field.place[3] in SPECIMEN && one.fields.some((other) => other.place.length === 4 && other.place[2] === field.place[2] && other.place[3] === "material_from");

function specimens() {
  const groups = new Map();
  for (const one of setup.data.experiments) {
    const own = one.fields.filter((field) => isSpecimen(one, field));
    for (const table of new Set(own.map((field) => field.place[2]))) {
      const of = (key) => own.find((field) => field.place[2] === table && field.place[3] === key);
      const material = ["material", "material_from"].map((key) => (of(key) ? typed(of(key)) : "")).find(Boolean) || "";
      const key = `${table}\n${material}`;
      if (!groups.has(key)) groups.set(key, { material, names: [], fields: {} });
      const group = groups.get(key);
      group.names.push(one.name);
      for (const column of Object.keys(SPECIMEN)) if (of(column)) (group.fields[column] ||= []).push(of(column));
    }
  }
  if (!groups.size) return null;
  const columns = Object.keys(SPECIMEN).filter((column) => [...groups.values()].some((group) => group.fields[column]));
  const rows = [...groups.values()].map((group) => {
    const cells = columns.map((column) => {
      const fields = group.fields[column];
      if (!fields) return make("td", { className: "is-empty" });
      const [input, ...more] = control(fields[0], fields, `${column.replace("_", " ")} of the specimen ${group.material || "without a material"}`);
      input.note = make("p", { className: "note" });
      return make("td", { dataset: { label: SPECIMEN[column] } }, input, ...more, input.note);
    });
    return make("tr", {}, ...cells, make("td", { dataset: { label: "experiments" }, textContent: group.names.join(", ") }));
  });
  const head = make("tr", {}, ...[...columns.map((column) => SPECIMEN[column]), "experiments"].map((text) => make("th", { textContent: text, scope: "col" })));
  return make("div", {}, make("h2", { textContent: "Specimens" }), make("p", { className: "note", textContent: "A value is asked for once and used by all experiments of its row, e.g. 9,525 ± 0,005 mm." }), make("div", { className: "wide" }, make("table", { className: "specimens" }, make("thead", {}, head), make("tbody", {}, ...rows))));
}

function records() {
  if (!setup.data.records.length) return null;
  const days = ["valid_from", "valid_until", "when", "who", "how"];
  const named = { valid_from: "valid from", valid_until: "until", when: "calibrated on", who: "by", how: "how" };
  const rows = setup.data.records.map((record) => {
    const of = (key) => record.fields.find((field) => field.place.length === 1 && field.place[0] === key);
    const own = (field) => row(field, `${field.label} of ${record.name}`);
    const rest = record.fields.filter((field) => !days.some((key) => of(key) === field));
    const isNeeded = (field) => field.place.length > 1 && (field.required || field.text || field.gap);
    const cells = days.map((key) => {
      const [input] = control(of(key), [of(key)], `${named[key]}, ${record.name}`);
      input.note = make("p", { className: "note" });
      return make("td", { dataset: { label: named[key] } }, input, input.note);
    });
    const values = make("td", { dataset: { label: "values" } }, ...rest.filter(isNeeded).map(own));
    const further = rest.filter((field) => !isNeeded(field));
    if (further.length) values.append(make("details", {}, make("summary", { textContent: "More values" }), ...further.map(own)));
    const name = make("th", { scope: "row" }, make("span", { textContent: record.name }), make("p", { className: "note", textContent: record.kind.replace("_", " ") }));
    const users = record.used_by.join(", ") || "none yet";
    return make("tr", {}, name, ...cells, values, make("td", { dataset: { label: "experiments" }, textContent: users }));
  });
  const head = make("tr", {}, ...["record", ...days.map((key) => named[key]), "values", "experiments"].map((text) => make("th", { textContent: text, scope: "col" })));
  return make("div", {}, make("h2", { textContent: "Calibrations and their days" }), make("p", { className: "note", textContent: "A record holds for recordings of its days, the first and the last one included." }), make("div", { className: "wide" }, make("table", { className: "specimens", id: "setup-records" }, make("thead", {}, head), make("tbody", {}, ...rows))));
}

function drawSetup() {
  const held = document.activeElement?.ariaLabel; // who goes by keyboard stays where they were
  const bar = make("div", { className: "bar" });
  const write = button("Look at the difference and write", () => look());
  write.id = "setup-write";
  write.className = "main";
  const undo = button("Undo all", () => views.setup(true));
  undo.id = "setup-undo";
  const versions = make("select", { id: "setup-versions" }, make("option", { value: "", textContent: "Undo a write …" }), ...setup.data.versions.map((value) => make("option", { value, textContent: `back to before ${value.slice(0, 19)} UTC` })));
  versions.setAttribute("aria-label", "Undo a write");
  versions.hidden = !setup.data.versions.length;
  versions.addEventListener("change", trying(async () => {
    // Every write kept the files that it changed: those after the chosen one are undone first.
    setup.edits = setup.data.versions.filter((version) => version >= versions.value).map((version) => ({ op: "restore", version }));
    await look();
  }));
  bar.append(write, undo, versions, make("span", { id: "setup-state" }));
  const dialog = make("dialog", { id: "difference" });
  dialog.setAttribute("aria-label", "What changes");
  by("setup").replaceChildren(
    ...[bar, make("ul", { id: "setup-problems", className: "note is-error" }), specimens(), records(), make("h2", { textContent: "Experiments" }), make("ul", { className: "cards", id: "setup-experiments" }, ...setup.data.experiments.map(experiment)), dialog].filter(Boolean));
  mark();
  if (held) [...document.querySelectorAll("#setup [aria-label]")].find((element) => element.ariaLabel === held)?.focus();
}

async function check(mustDraw) {
  const turn = (setup.turn += 1);
  const found = await ask("api/check", { base: setup.base, edits: setup.edits }).catch(async (error) => {
    if (error.message.includes("changed elsewhere")) await views.setup(true);
    throw error;
  });
  if (turn !== setup.turn) return;
  setup.data = found;
  say("");
  if (mustDraw) drawSetup();
  else mark();
}

async function look() {
  clearTimeout(setup.timer);
  await check(false);
  const dialog = by("difference");
  const lines = setup.data.difference.map((line) => make("span", { className: line.startsWith("+") ? "plus" : line.startsWith("-") ? "minus" : "", textContent: `${line}\n` }));
  const writing = async () => {
    dialog.close();
    const found = await ask("api/write", { base: setup.base, edits: setup.edits });
    await loadFiles();
    Object.assign(setup, { base: found.base, edits: found.edits, data: found });
    drawSetup();
    say(`Written: ${found.written.join(", ") || "nothing"}. The version before is kept.`);
  };
  const put = button("Write", writing);
  put.id = "difference-write";
  put.className = "main";
  const wrong = [...new Set([...document.querySelectorAll("#setup .is-wrong")].flatMap((input) => input.fields.map((field) => `${field.place.join(".")} in ${field.file}`)))];
  const warning = wrong.length ? make("p", { className: "is-error", textContent: `Nothing runs before ${wrong.length === 1 ? "this is" : "these are"} corrected: ${wrong.join(", ")}.` }) : "";
  dialog.replaceChildren(make("h2", { textContent: "What changes" }), warning, make("ul", { id: "difference-words" }, ...(lines.length ? setup.data.words : ["nothing"]).map((textContent) => make("li", { textContent }))), make("details", {}, make("summary", { textContent: "The lines" }), make("pre", {}, ...lines)), make("div", { className: "bar" }, put, button("Write and process", async () => {
    await writing();
    await go("run");
    by("start").click();
  }), button("Back", () => {
    dialog.close();
    if (setup.edits.some((edit) => edit.op === "restore")) return views.setup(true);
    return undefined;
  })));
  dialog.showModal();
}

views.setup = async (again = false) => {
  if (setup.data && setup.edits.length && !again) return;
  await loadFiles();
  if (!setup.data) by("setup").replaceChildren(make("p", { textContent: "Looking at every file …" }));
  const found = await ask("api/session").catch((error) => {
    by("setup").replaceChildren(make("p", { textContent: error.message }));
    throw error;
  });
  if (!again && setup.data && found.base === setup.base && isSession) return;
  Object.assign(setup, { base: found.base, edits: found.edits, data: found });
  drawSetup();
};
