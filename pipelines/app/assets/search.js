// Search in the guide of labpipe open --guide: sections that hold every typed word, those with it in their heading first.
"use strict";

const field = document.getElementById("search");
const found = document.getElementById("found");
const MOST = 30;
let reading; // all sections, read when they are first asked for

async function sections(link) {
  const page = new DOMParser().parseFromString(await (await fetch(link.href)).text(), "text/html");
  const made = [];
  for (const node of page.querySelectorAll("main > :not(.to-contents)")) {
    if (/^H\d$/.test(node.tagName)) {
      const title = made.length ? `${link.textContent}: ${node.textContent}` : node.textContent;
      made.push({ address: `${link.href}#${node.id}`, title, text: "" });
    } else if (made.length) {
      made.at(-1).text += ` ${node.textContent.replace(/\s+/g, " ")}`;
    }
  }
  return made;
}

function item(section, word) {
  const made = document.createElement("li"), link = document.createElement("a"), words = document.createElement("p");
  link.href = section.address;
  link.textContent = section.title;
  const place = Math.max(section.text.toLowerCase().indexOf(word) - 40, 0);
  words.textContent = `${place ? "… " : ""}${section.text.slice(place, place + 120).trim()} …`;
  made.append(link, words);
  return made;
}

async function search() {
  reading ??= Promise.all([...document.querySelectorAll("#contents .pages a")].map(sections));
  const all = (await reading).flat(); // the field may have changed meanwhile
  const words = field.value.toLowerCase().split(/\s+/).filter(Boolean);
  const inside = (text) => words.every((word) => text.toLowerCase().includes(word));
  const hits = words.length ? all.filter((one) => inside(`${one.title} ${one.text}`)) : [];
  hits.sort((a, b) => inside(b.title) - inside(a.title));
  found.replaceChildren(...hits.slice(0, MOST).map((one) => item(one, words[0])));
  document.getElementById("count").textContent = words.length ? `${hits.length} section${hits.length === 1 ? "" : "s"}` : "";
}

field.addEventListener("input", search);
field.addEventListener("keydown", (event) => {
  if (event.key === "Enter") found.querySelector("a")?.click();
});
