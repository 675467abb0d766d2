// The list of tracks, a strip of close-ups for each. Only the strips in sight are elements, and a close-up is painted when it
// comes into sight, so that thousands of tracks through hundreds of photographs stay quick.

import { closeUp, sizeOf } from "#report/closeup.js";
import { make, shown } from "#report/dom.js";
import { paintOf } from "#report/items.js";

const ROW = 128; // px, as in report.css
const SPARE = 2; // strips above and below those in sight
const CHIP = [96, 72]; // px

export class Strips {
  /** element: of the page. panels: of the photographs. on: {select(item), hover(item or null), zoom(item)}. */
  constructor(element, panels, names, on) {
    Object.assign(this, { element, panels, names, on, items: [] });
    this.space = make("div", { class: "space", role: "presentation" });
    element.append(this.space);
    element.addEventListener("scroll", () => this.draw());
    element.addEventListener("pointerleave", () => on.hover(null));
    this.painter = new IntersectionObserver((entries) => {
      for (const { isIntersecting, target } of entries) {
        if (!isIntersecting) continue;
        this.painter.unobserve(target);
        const polygon = target.polygon;
        closeUp(target, panels[polygon.photograph], CHIP, polygon.center, sizeOf(polygon.box), polygon);
      }
    });
    new ResizeObserver(() => this.draw()).observe(element);
  }

  show(items, state) {
    Object.assign(this, { items, state });
    this.rows = new Map();
    this.space.replaceChildren();
    this.space.style.height = `${items.length * ROW}px`;
    this.draw();
  }

  reveal(key) {
    const at = this.items.findIndex((item) => item.key === key) * ROW;
    const { scrollTop, clientHeight } = this.element;
    if (at >= 0 && (at < scrollTop || at + ROW > scrollTop + clientHeight)) this.element.scrollTop = at - (clientHeight - ROW) / 2;
  }

  mark(hovered, selected) {
    Object.assign(this, { hovered, selected });
    for (const [key, row] of this.rows ?? []) {
      row.classList.toggle("hovered", key === hovered);
      row.setAttribute("aria-selected", key === selected);
    }
  }

  draw() {
    const first = Math.max(0, Math.floor(this.element.scrollTop / ROW) - SPARE);
    const last = Math.ceil((this.element.scrollTop + this.element.clientHeight) / ROW) + SPARE;
    const wanted = this.items.slice(first, last);
    const keys = new Set(wanted.map((item) => item.key));
    for (const [key, row] of this.rows ?? []) {
      if (keys.has(key)) continue;
      row.remove();
      this.rows.delete(key);
    }
    wanted.forEach((item, k) => {
      if (this.rows.has(item.key)) return;
      const row = this.row(item, first + k);
      this.rows.set(item.key, row);
      this.space.append(row);
    });
    this.mark(this.hovered, this.selected);
  }

  row(item, index) {
    const swatch = make("i", { class: "swatch" });
    swatch.style.background = paintOf(item, this.state.color, {}).color;
    const absent = item.absent.map(([row, why]) => `${this.names[row]}: ${why}`).join("\n");
    const facts = [
      `in ${item.length} photograph${item.length === 1 ? "" : "s"}`,
      `confidence from ${shown(item.confidence, 2)}`,
      item.carried && `${item.carried} carried`,
      item.closed && `confirmed by ${item.closed} match${item.closed === 1 ? "" : "es"}`,
    ].filter(Boolean);
    const head = make("p", {}, swatch, make("b", {}, `Track ${item.id}`), make("small", {}, facts.join(", ")));
    if (absent) head.append(make("small", { class: "absent", title: absent }, `not in ${item.absent.length} others`));
    const row = make(
      "div",
      {
        role: "option",
        class: "strip",
        "data-key": item.key,
        onpointerenter: () => this.on.hover(item),
        onclick: () => this.on.select(item),
        ondblclick: () => this.on.zoom(item),
      },
      head,
      make("div", { class: "chips-row" }, item.seen.map((polygon) => this.chip(polygon))),
    );
    row.style.top = `${index * ROW}px`;
    return row;
  }

  chip(polygon) {
    const name = this.names[polygon.photograph];
    const canvas = make("canvas", { role: "img", "aria-label": name });
    [canvas.style.width, canvas.style.height] = CHIP.map((length) => `${length}px`);
    canvas.polygon = polygon;
    this.painter.observe(canvas);
    const text = `${polygon.carried ? "carried" : "matched"} ${shown(polygon.confidence, 2)}`;
    return make("figure", { class: polygon.carried ? "carried" : null, title: `${name}: ${text}` }, canvas, make("figcaption", {}, make("span", {}, name), shown(polygon.confidence, 2)));
  }
}
