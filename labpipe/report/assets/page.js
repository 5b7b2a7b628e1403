"use strict";
/* What a page does besides charts: sortable tables, galleries, copying. */
(() => {
  document.documentElement.classList.add("has-scripts");

  const compare = (a, b) => {
    const x = Number(a), y = Number(b);
    // Empty cells come last in either order, so they are handled by the caller.
    if (a.trim() !== "" && b.trim() !== "" && !Number.isNaN(x) && !Number.isNaN(y)) return x - y;
    return a.localeCompare(b, "en", { numeric: true });
  };

  const sortBy = (table, heading) => {
    const column = heading.cellIndex;
    const sign = heading.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
    const body = table.tBodies[0];
    const keyed = [...body.rows].map((row) => [row.cells[column].dataset.key ?? "", row]);
    keyed.sort(([a], [b]) => (a === "") - (b === "") || sign * compare(a, b));
    body.append(...keyed.map(([, row]) => row));
  };

  for (const button of document.querySelectorAll("table.sortable .sort")) {
    button.addEventListener("click", () => sortBy(button.closest("table"), button.closest("th")));
  }

  // On a narrow screen a row is a card, whose cells say what they are.
  for (const table of document.querySelectorAll("table.cards")) {
    const titles = [...table.tHead.rows[0].cells].map((heading) => heading.textContent.trim());
    for (const row of table.tBodies[0].rows) {
      for (const cell of row.cells) if (cell.cellIndex > 0 || cell.className === "number") cell.dataset.title = titles[cell.cellIndex];
    }
  }

  for (const gallery of document.querySelectorAll(".gallery")) {
    const frames = [...gallery.querySelectorAll(".frame")];
    const slider = gallery.querySelector("input");
    const shownAs = gallery.querySelector("output");
    const show = (index) => {
      const place = Math.min(Math.max(index, 0), frames.length - 1);
      slider.value = String(place);
      frames.forEach((frame, i) => frame.classList.toggle("is-shown", i === place));
      shownAs.textContent = `${place + 1} of ${frames.length}`;
      // Charts of the gallery's group mark where this frame lies.
      gallery.dataset.at = frames[place].dataset.at;
      gallery.dispatchEvent(new CustomEvent("frame", { bubbles: true }));
    };
    slider.addEventListener("input", () => show(Number(slider.value)));
    gallery.querySelector(".gallery-previous").addEventListener("click", () => show(Number(slider.value) - 1));
    gallery.querySelector(".gallery-next").addEventListener("click", () => show(Number(slider.value) + 1));
    show(Number(gallery.dataset.start));
  }

  for (const button of document.querySelectorAll(".copy")) {
    button.addEventListener("click", () => {
      // navigator.clipboard is missing on pages opened from a folder; a selection always works.
      const range = document.createRange();
      range.setStartAfter(button);
      range.setEndAfter(button.parentElement.lastElementChild);
      const selection = window.getSelection();
      selection.removeAllRanges();
      selection.addRange(range);
      button.textContent = document.execCommand("copy") ? "Copied" : "Selected";
    });
  }
})();
