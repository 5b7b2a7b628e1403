"use strict";
// The page of `labpipe open`. Every text from a file is set as text, never as HTML.

const by = (id) => document.getElementById(id);
const make = (tag, properties = {}, ...children) => {
  const { dataset, ...plain } = properties;
  const made = Object.assign(document.createElement(tag), plain);
  Object.assign(made.dataset, dataset || {});
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
};

function say(text, isError = false) {
  by("message").textContent = text;
  by("message").classList.toggle("is-error", isError);
}

async function ask(path, body) {
  const options = body === undefined ? {} : { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) };
  let answer;
  try {
    answer = await fetch(path, options);
  } catch {
    throw new Error("labpipe does not answer; is `labpipe open` still running? What was written is kept.");
  }
  const found = await answer.json().catch(() => ({ error: `labpipe answered ${answer.status}` }));
  if (!answer.ok) throw Object.assign(new Error(found.error || `labpipe answered ${answer.status}`), found, { status: answer.status });
  return found;
}

const trying = (work) => async (...given) => {
  try {
    return await work(...given);
  } catch (error) {
    say(error.message, true);
    return undefined;
  }
};

const views = {};
let shown = "";
// Every part, and every report, has an address of its own behind the #: Back and a reload find it again.
const addressed = () => decodeURIComponent(location.hash.slice(1)) || "files";
let routed = "";
function route() {
  routed = addressed();
  const [part, ...page] = routed.split("/");
  return show(views[part] ? part : "files", page.join("/"));
}
function go(place) {
  location.hash = place.split("/").map(encodeURIComponent).join("/");
  return route();
}
function show(name, page = "") {
  shown = name;
  for (const button of document.querySelectorAll("nav button")) {
    const isShown = button.dataset.view === name;
    by(button.dataset.view).hidden = !isShown;
    if (isShown) button.setAttribute("aria-current", "page");
    else button.removeAttribute("aria-current");
  }
  say("");
  return trying(views[name])(page || undefined);
}

// --- files ---

by("count").textContent = "Looking at every file …";
let files = [];
let last = "";
let isSession = false;
const size = (n) => (n < 1e3 ? `${n} B` : n < 1e6 ? `${(n / 1e3).toFixed(0)} kB` : n < 1e9 ? `${(n / 1e6).toFixed(1)} MB` : `${(n / 1e9).toFixed(2)} GB`);
const hasPicture = (file) => ["displacement", "force", "film", "sweep", "picture"].includes(file.content);

function pictureOf(file) {
  const image = make("img", { loading: "lazy", alt: `${file.kind}: ${file.name}`, src: `api/picture?name=${encodeURIComponent(file.name)}&at=${encodeURIComponent(file.modified)}` });
  image.addEventListener("error", () => image.remove());
  return image;
}

function fileCard(file) {
  const state = file.used_by.length ? "is-ok" : file.copy_of ? "is-warning" : "";
  const card = make("li", {}, make("h3", { textContent: file.name }));
  if (hasPicture(file)) card.append(pictureOf(file));
  card.append(make("p", { textContent: `${file.kind || "not recognised"} · ${size(file.size)} · ${file.modified}` }));
  const use = file.used_by.length ? `used by ${file.used_by.join(", ")}; ${file.reason}` : isSession || !file.content || file.copy_of || file.content === "picture" ? `not used: ${file.reason}` : file.reason;
  card.append(make("p", { className: state, textContent: use }));
  if (file.content === "picture" || file.content === "film") {
    card.append(make("p", {}, ...[["film", "Watch it"], ["measure", "Measure in it"]].slice(file.content === "film" ? 0 : 1).map(([part, text]) => button(text, () => go(`${part}/${file.name}`)))));
  }
  return card;
}

function drawFiles() {
  const wanted = by("show-files").value;
  const fits = { "": () => true, used: (f) => f.used_by.length, unused: (f) => !f.used_by.length, copies: (f) => f.copy_of || files.some((g) => g.copy_of === f.name) };
  // Recordings first, then pictures, then what nothing recognises; a copy stands beside what it is a copy of.
  const rank = (file) => (!file.kind ? 2 : file.content === "picture" ? 1 : 0);
  const place = (file) => `${rank(file)}${file.copy_of || file.name}\n${file.copy_of ? 1 : 0}${file.name}`;
  const chosen = files.filter(fits[wanted]).sort((a, b) => (place(a) < place(b) ? -1 : 1));
  by("file-list").replaceChildren(...chosen.map(fileCard));
  by("count").textContent = `${chosen.length} of ${files.length} files`;
}

async function loadFiles() {
  const found = await ask("api/files");
  const text = JSON.stringify(found);
  if (text === last) return;
  last = text;
  by("folder").textContent = found.folder;
  document.title = `${found.folder} – labpipe`;
  files = found.files;
  isSession = found.is_session;
  by("begin").hidden = isSession;
  by("start").disabled = by("watch").disabled = !isSession;
  by("run-hint").hidden = isSession;
  drawFiles();
  const chosen = by("pages").value || "index.html";
  by("pages").replaceChildren(...found.pages.map((page) => make("option", { value: page, textContent: page.replace(/^reports\/|\.html$/g, "") })));
  by("pages").value = found.pages.includes(chosen) ? chosen : found.pages[0] || "";
  drawBeside();
  if (shown === "run") await loadOutlook();
}
views.files = loadFiles;

by("show-files").addEventListener("change", drawFiles);
by("begin").addEventListener("click", () => go("setup"));

// --- run ---

let run = { number: 0, next: 0, of: new Map() };

let outlook = { summary: "", known: true, experiments: [], problem: "", unused: [] };

const steps = (n) => `${n} step${n === 1 ? "" : "s"}`;

function experimentCard(name) {
  const one = run.of.get(name) || {};
  const ahead = outlook.experiments.find((card) => card.name === name);
  const level = { yes: "is-ok", doubtful: "is-warning", impossible: "is-error" }[one.believable] || (one.state === "failed" ? "is-error" : one.state === "waiting" ? "is-warning" : "");
  const card = make("li", {}, make("h3", { textContent: name }));
  if (ahead && ahead.title) card.append(make("p", { textContent: ahead.title }));
  if (one.text || one.state) card.append(make("p", { className: level, textContent: one.text || one.state }));
  for (const finding of one.findings || []) {
    if (finding.level === "note") continue;
    const where = finding.file ? ` (${finding.file}${finding.line ? `:${finding.line}` : ""})` : "";
    card.append(make("p", { className: finding.level === "impossible" ? "is-error" : "is-warning", textContent: `${finding.check}: ${finding.message}${where}` }));
  }
  if (one.causes && one.causes.length && (one.findings || []).some((finding) => finding.level !== "note")) card.append(make("p", { textContent: `probable cause: ${one.causes[0]}` }));
  if (one.failure) card.append(make("p", { className: "is-error", textContent: one.failure }));
  if (ahead && !run.isRunning) card.append(...aheadOf(ahead, one));
  const bar = make("div", { className: "bar" });
  if (one.page || (ahead && ahead.page)) {
    const button = make("button", { type: "button", textContent: ahead && ahead.to_run && !run.isRunning ? "Last report" : "Report" });
    button.addEventListener("click", () => go(`report/reports/${name}.html`));
    bar.append(button);
  }
  if (!run.isRunning && ((ahead && (ahead.waits.length || ahead.failed)) || one.failure)) {
    const button = make("button", { type: "button", textContent: "Set-up" });
    button.addEventListener("click", () => go("setup"));
    bar.append(button);
  }
  if (bar.children.length) card.append(bar);
  return card;
}

// What the next run would do with an experiment.
function aheadOf(ahead, told) {
  const lines = [];
  if (ahead.waits.length && told.state !== "waiting") lines.push(make("p", { className: "is-warning", textContent: `waits for:\n${ahead.waits.join("\n")}` }));
  if (ahead.failed && !told.failure) lines.push(make("p", { className: "is-error", textContent: `failed last time: ${ahead.failed}` }));
  if (!ahead.steps) return lines;
  if (!ahead.to_run) return told.text || told.state ? lines : [...lines, make("p", { className: "is-ok", textContent: "up to date" })];
  const of = ahead.to_run === ahead.steps ? steps(ahead.steps) : `${ahead.to_run} of ${steps(ahead.steps)}`;
  lines.push(make("p", { textContent: `would run: ${of} (${ahead.why})` }));
  lines.push(make("details", {}, make("summary", { textContent: "What they do" }), make("ul", { className: "note" }, ...ahead.what.map((text) => make("li", { textContent: text })))));
  return lines;
}

function drawRun() {
  const shownNames = [...new Set([...outlook.experiments.map((card) => card.name), ...run.of.keys()])];
  const isOpen = new Set([...document.querySelectorAll("#experiments > li")].filter((card) => card.querySelector("details[open]")).map((card) => card.dataset.name));
  // Cards are drawn anew as news arrive: who goes by keyboard stays where they were.
  const reached = (card) => [...card.querySelectorAll("button, summary")];
  const held = document.activeElement?.closest("#experiments > li");
  const place = held ? reached(held).indexOf(document.activeElement) : -1;
  by("experiments").replaceChildren(...shownNames.map((name) => {
    const card = experimentCard(name);
    card.dataset.name = name;
    if (isOpen.has(name) && card.querySelector("details")) card.querySelector("details").open = true;
    return card;
  }));
  const again = held && [...by("experiments").children].find((card) => card.dataset.name === held.dataset.name);
  if (again && reached(again).length) reached(again).at(Math.min(place, reached(again).length - 1)).focus({ preventScroll: true });
  const parts = [];
  if (!run.isRunning && isSession) {
    if (outlook.summary) parts.push(outlook.experiments.every((card) => !card.to_run && !card.waits.length) ? "Everything is up to date." : `${outlook.summary}.`);
    if (outlook.summary && !outlook.known) parts.push("How long these take is known once they have run.");
  }
  by("outlook").textContent = parts.join(" ");
  by("progress").hidden = !run.number;
  by("log").parentElement.hidden = !by("log").children.length;
  const more = [];
  if (outlook.problem && !run.isRunning) more.push(make("p", { className: "is-error", textContent: `Nothing can be processed yet: ${outlook.problem}` }), make("p", { className: "note", textContent: "While you record, “Watch the folder” processes each experiment as soon as its files are there." }));
  if (outlook.unused.length && isSession) more.push(make("p", { className: "is-warning", textContent: `No experiment uses ${outlook.unused.length === 1 ? "this recording" : `these ${outlook.unused.length} recordings`} yet: ${outlook.unused.slice(0, 8).join(", ")}${outlook.unused.length > 8 ? " …" : ""}. The set-up adds a recording on the card of its experiment.` }));
  by("outlook-more").replaceChildren(...more);
}

async function loadOutlook() {
  outlook = isSession ? await ask("api/plan") : { summary: "", known: true, experiments: [], problem: "", unused: [] };
  drawRun();
}

const note = (name, facts) => run.of.set(name, { ...(run.of.get(name) || {}), ...facts });

function take(event) {
  const name = event.experiment;
  if (event.kind === "verdict") {
    const model = event.model === "none" ? "" : `, model: ${event.model}`;
    note(name, { believable: event.believable, findings: event.findings, causes: event.causes, text: `believable: ${event.believable}${model}` });
  } else if (event.kind === "news") {
    note(name || "session", { state: event.state, text: `${event.state}: ${event.message}`, page: event.state === "processed" });
  } else if (event.kind === "waiting") {
    note(name, { state: "waiting", text: `waits for:\n${event.message}` });
  } else if (event.kind === "finished") {
    for (const page of event.reports) note(page, { page: true });
    say(`Finished: ${event.message}`);
  } else if (event.kind === "stopped" || event.kind === "refused") {
    say(event.message, event.kind === "refused");
  } else {
    if (event.kind === "failed") note(name, { state: "failed", failure: `${event.stage}: ${event.message}` });
    else if (!(run.of.get(name) || {}).believable) note(name, { state: event.kind === "started" ? event.stage : `${event.stage} ${event.kind}` });
    if (event.stage === "report" && ["done", "cached", "kept"].includes(event.kind)) note(name, { page: true });
    by("progress").max = event.total || 1;
    by("progress").value = event.done;
    by("progress-text").textContent = `${event.done} of ${event.total} steps`;
  }
  const text = [event.kind, name, event.stage, event.recording, event.message || event.summary].filter(Boolean).join(" · ");
  by("log").append(make("li", { textContent: text }));
}

async function loadRun() {
  let found = await ask(`api/run?after=${run.next}`);
  if (found.run !== run.number) {
    run = { number: found.run, next: 0, of: new Map() };
    by("log").replaceChildren();
    by("progress").value = 0;
    by("progress-text").textContent = "";
    found = await ask("api/run?after=0");
  }
  run.next = found.next;
  found.events.forEach(take);
  run.isRunning = found.running;
  if (found.events.length) drawRun();
  by("start").disabled = by("watch").disabled = found.running || !isSession;
  by("stop").disabled = !found.running;
  if (found.running && !found.next) by("progress-text").textContent = "starting …";
  if (found.running && found.mode === "watch") by("progress-text").textContent = "watching; each experiment is processed when its files are complete";
  by("start").textContent = found.code === 130 ? "Go on" : "Process";
  if (found.error) say(found.error, true);
  if (run.wasRunning && !found.running) {
    await loadFiles();
    await loadOutlook();
  }
  if (!run.wasRunning && found.running) drawRun();
  run.wasRunning = found.running;
}
views.run = async () => {
  await loadFiles();
  await loadRun();
  await loadOutlook();
};

for (const [id, action] of [["start", "process"], ["watch", "watch"], ["stop", "stop"]]) {
  by(id).addEventListener("click", trying(async () => {
    await ask("api/run", { action });
    say(action === "stop" ? "Stopping; what is complete is kept." : "");
    await loadRun();
  }));
}

// --- reports ---

views.report = async (page) => {
  await loadFiles();
  const names = [...by("pages").options].map((option) => option.value);
  if (page && !names.includes(page)) by("pages").append(make("option", { value: page, textContent: page.replace(/^reports\/|\.html$/g, "") }));
  by("pages").value = page || (names.includes("index.html") ? "index.html" : names[0] || "");
  const isThere = Boolean(by("pages").value);
  by("report-hint").hidden = isThere;
  by("page").hidden = by("report-bar").hidden = !isThere;
  drawBeside();
  if (!isThere) return;
  // A frame that is new leaves no step of its own in the history of the window.
  const frame = by("page").cloneNode();
  frame.src = `reports/${by("pages").value.split("/").map(encodeURIComponent).join("/")}`;
  by("page").replaceWith(frame);
};
by("pages").addEventListener("change", () => go(`report/${by("pages").value}`));

const experimentOf = (page) => (page.match(/^reports\/(.*)\.html$/) || [])[1];
function drawBeside() {
  const own = experimentOf(by("pages").value);
  const others = [...by("pages").options].map((option) => experimentOf(option.value)).filter((name) => name && name !== own);
  by("beside").parentElement.hidden = !own || !others.length;
  by("beside").replaceChildren(make("option", { value: "", textContent: "…" }), ...others.map((name) => make("option", { value: name, textContent: name })));
}
by("beside").addEventListener("change", trying(async () => {
  if (!by("beside").value) return;
  const found = await ask("api/beside", { first: experimentOf(by("pages").value), second: by("beside").value });
  await loadFiles();
  go(`report/${found.page}`);
}));

// --- beginning ---

for (const button of document.querySelectorAll("nav button")) button.addEventListener("click", () => go(button.dataset.view));
addEventListener("hashchange", () => addressed() !== routed && route());
let isBusy = false;
setInterval(async () => {
  if (isBusy || document.hidden) return;
  isBusy = true;
  try {
    await loadRun();
    if (shown === "files" || shown === "run") await loadFiles();
  } catch (error) {
    say(error.message, true);
  }
  isBusy = false;
}, 1000);
addEventListener("load", route);
