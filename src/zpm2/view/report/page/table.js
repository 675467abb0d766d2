// The table of items. Only the rows in sight are elements, so that thousands of rows stay quick.

import { make, shown } from "#report/dom.js";

const ROW = 26; // px, as in report.css
const SPARE = 8; // rows above and below those in sight

/** The columns of a pair: name, title, meaning, the text of an item, and the width in CSS. */
export const PAIR_COLUMNS = [
  ["id", "Id", "the match's id, or that of a polygon without a partner", (item) => (item.kind === "match" ? String(item.id) : `${item.id} ${item.kind[0].toUpperCase()}`), "62px"],
  ["label", "Label", "the left polygon's label", (item) => item.label, "minmax(56px, 1fr)"],
  ["stage", "Stage / why", "the stage that found the match, or why there is none", (item) => item.stage ?? item.why, "minmax(74px, 1fr)"],
  ["confidence", "Conf.", "chance that the match is right", (item) => shown(item.confidence, 2), "46px"],
  ["area", "Area", "px² of the polygon, of the left one in a match", (item) => shown(item.area), "62px"],
  ["cost", "Cost", "cost ζ: lower is better", (item) => shown(item.cost, 2), "46px"],
  ["dsf", "DSF", "homologous points inside both polygons", (item) => shown(item.dsf), "38px"],
  ["verdict", "✓", "your verdict", (item) => ({ right: "✓", wrong: "✗" })[item.verdict] ?? "", "20px"],
];

/** The columns that some item fills, and that of verdicts. */
export function filled(columns, items) {
  return columns.filter(([name, , , text]) => name === "verdict" || items.some((item) => ![null, undefined, "", "–"].includes(text(item))));
}

export class Table {
  /** head, body: elements of the page. columns: as `PAIR_COLUMNS`. on: {sort(column), select(item), hover(item or null),
   * color(item)}. */
  constructor(head, body, columns, on) {
    Object.assign(this, { head, body, columns, on });
    head.parentElement.style.setProperty("--columns", columns.map(([, , , , width]) => width).join(" "));
    this.space = make("div", { class: "space", role: "presentation" });
    body.append(this.space);
    this.items = [];
    body.addEventListener("scroll", () => this.draw());
    body.addEventListener("pointerleave", () => on.hover(null));
  }

  show(items, state) {
    Object.assign(this, { items, state });
    this.head.replaceChildren(
      ...this.columns.map(([name, text, title]) => {
        const here = state.sort === name;
        const direction = here ? (state.down ? "descending" : "ascending") : "none";
        const arrow = here ? (state.down ? " ▾" : " ▴") : "";
        const button = make("button", { title, type: "button", onclick: () => this.on.sort(name) }, text + arrow);
        return make("div", { role: "columnheader", "aria-sort": direction, class: `c-${name}` }, button);
      }),
    );
    this.space.style.height = `${items.length * ROW}px`;
    this.body.setAttribute("aria-rowcount", items.length);
    this.draw();
  }

  /** Scrolls so that an item is in sight. */
  reveal(key) {
    const at = this.items.findIndex((item) => item.key === key) * ROW;
    const { scrollTop, clientHeight } = this.body;
    if (at >= 0 && (at < scrollTop || at + ROW > scrollTop + clientHeight)) {
      this.body.scrollTop = at - clientHeight / 2;
    }
  }

  mark(hovered, selected) {
    Object.assign(this, { hovered, selected });
    for (const row of this.space.children) {
      row.classList.toggle("hovered", row.dataset.key === hovered);
      row.setAttribute("aria-selected", row.dataset.key === selected);
    }
  }

  draw() {
    const first = Math.max(0, Math.floor(this.body.scrollTop / ROW) - SPARE);
    const last = Math.ceil((this.body.scrollTop + this.body.clientHeight) / ROW) + SPARE;
    this.space.replaceChildren(...this.items.slice(first, last).map((item, k) => this.row(item, first + k)));
    this.mark(this.hovered, this.selected);
  }

  row(item, index) {
    const cells = Object.fromEntries(this.columns.map(([name, , , text]) => [name, text(item)]));
    const swatch = make("i", { class: "swatch" });
    swatch.style.background = this.on.color(item);
    const row = make(
      "div",
      {
        role: "row",
        "aria-rowindex": index + 1,
        "data-key": item.key,
        class: item.kind === "match" ? "item" : "item alone",
        onpointerenter: () => this.on.hover(item),
        onclick: () => this.on.select(item),
      },
      this.columns.map(([name]) =>
        make("div", { role: "cell", class: `c-${name}`, title: name === "label" || name === "stage" ? cells[name] : null }, name === "id" && swatch, cells[name]),
      ),
    );
    row.style.top = `${index * ROW}px`;
    return row;
  }
}
