"use strict";
// A film played in the page. The server draws results on its frames, which are fetched as they are shown.

const film = { name: "", frames: 0, index: 0, isPlaying: false, made: new Map() };
const AHEAD = 4; // frames fetched before they are shown
const KEPT = 60; // frames kept, to step back

function drawFilm() {
  const part = by("film");
  if (part.childElementCount) return;
  const file = make("select", { id: "film-file" });
  const drawn = make("input", { id: "film-drawn", type: "checkbox", checked: true });
  const slider = make("input", { id: "film-slider", type: "range", min: 0, value: 0, ariaLabel: "Frame" });
  part.append(
    make("div", { className: "bar" }, make("label", {}, "Film ", file), make("label", {}, drawn, " results drawn"), make("span", { id: "film-of", className: "note" })),
    make("img", { id: "film-image", alt: "" }), make("p", { id: "film-caption" }), slider,
    make("div", { className: "bar" }, button("Play", play), make("span", { id: "film-jumps" }), make("span", { className: "note", textContent: "Space plays, arrow keys step, with Shift by ten, Home and End" })));
  part.querySelector("button").id = "film-play";
  file.addEventListener("change", () => go(`film/${file.value}`));
  drawn.addEventListener("change", trying(() => frame(film.index)));
  slider.addEventListener("input", trying(() => frame(Number(slider.value))));
  document.addEventListener("keydown", trying(async (event) => {
    if (shown !== "film" || !film.frames || event.target.matches("select") || (event.key === " " && event.target.matches("button, [type=checkbox]"))) return;
    const step = event.shiftKey ? 10 : 1;
    const to = { ArrowLeft: film.index - step, ArrowRight: film.index + step, Home: 0, End: film.frames - 1 }[event.key];
    if (to === undefined && event.key !== " ") return;
    event.preventDefault();
    await (to === undefined ? play() : frame(to));
  }));
}

function fetched(index) {
  const key = `api/film?name=${encodeURIComponent(film.name)}&index=${index}&drawn=${Number(by("film-drawn").checked)}`;
  if (!film.made.has(key)) film.made.set(key, ask(key).catch((error) => { film.made.delete(key); throw error; }));
  if (film.made.size > KEPT) film.made.delete(film.made.keys().next().value);
  return film.made.get(key);
}

async function frame(wanted) {
  const index = film.index = Math.min(Math.max(wanted, 0), film.frames - 1);
  by("film-slider").value = index;
  const found = await fetched(index);
  if (index !== film.index) return; // another one is wanted by now
  by("film-image").hidden = !found.image;
  Object.assign(by("film-image"), { src: found.image, alt: found.caption });
  by("film-caption").textContent = found.caption;
}

async function play() {
  film.isPlaying = !film.isPlaying;
  by("film-play").textContent = film.isPlaying ? "Pause" : "Play";
  if (film.isPlaying && film.index === film.frames - 1) film.index = -1;
  while (film.isPlaying && shown === "film" && film.index < film.frames - 1) {
    const pause = new Promise((done) => setTimeout(done, 40));
    for (let i = 1; i <= AHEAD && film.index + i < film.frames; i += 1) fetched(film.index + i).catch(() => {});
    await frame(film.index + 1);
    await pause;
  }
  if (film.isPlaying) await play(); // the end: the button says so
}

views.film = async (name) => {
  drawFilm();
  await loadFiles();
  const names = files.filter((file) => file.content === "film").map((file) => file.name);
  by("film-file").replaceChildren(make("option", { value: "", textContent: names.length ? "choose …" : "no film here" }), ...names.map((one) => make("option", { value: one, textContent: one })));
  film.name = by("film-file").value = names.includes(name) ? name : film.name || "";
  if (!film.name) return;
  const found = await ask(`api/film?name=${encodeURIComponent(film.name)}`);
  Object.assign(film, { frames: found.frames, made: new Map() });
  by("film-slider").max = found.frames - 1;
  by("film-of").textContent = found.experiment ? `result of ${found.experiment}` : "no result of this film is up to date: nothing is drawn";
  by("film-jumps").replaceChildren(...Object.entries(found.jumps).map(([text, index]) => button(text, () => frame(index))));
  await frame(0);
};
