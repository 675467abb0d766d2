// The table of items. Only the rows in sight are elements, so that thousands of rows stay quick.

import { make, shown } from "#report/dom.js";
import { paintOf } from "#report/items.js";

const ROW = 26; // px, as in report.css
const SPARE = 8; // rows above and below those in sight
const COLUMNS = [
  ["id", "Id", "the match's id, or that of a polygon without a partner"],
  ["label", "Label", "the left polygon's label"],
  ["stage", "Stage / why", "the stage that found the match, or why there is none"],
  ["confidence", "Conf.", "chance that the match is right"],
  ["area", "Area", "px² of the polygon, of the left one in a match"],
  ["cost", "Cost", "cost ζ: lower is better"],
  ["dsf", "DSF", "homologous points inside both polygons"],
  ["verdict", "✓", "your verdict"],
];

export class Table {
  /** head, body: elements of the page. labels: whether any polygon has one. on: {sort(column), select(item), hover(item or null)}. */
  constructor(head, body, labels, on) {
    Object.assign(this, { head, body, on });
    this.columns = COLUMNS.filter(([name]) => name !== "label" || labels);
    body.parentElement.classList.toggle("labelled", labels);
    this.space = make("div", { class: "space", role: "presentation" });
    body.append(this.space);
    this.items = [];
    body.addEventListener("scroll", () => this.draw());
    body.addEventListener("pointerleave", () => on.hover(null));
  }

  show(items, state, verdicts, reasons) {
    Object.assign(this, { items, state, verdicts, reasons });
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
    const cells = {
      id: item.kind === "match" ? String(item.id) : `${item.id} ${item.kind[0].toUpperCase()}`,
      label: item.label,
      stage: item.stage ?? item.why,
      confidence: shown(item.confidence, 2),
      area: shown(item.area),
      cost: shown(item.cost, 2),
      dsf: shown(item.dsf),
      verdict: { right: "✓", wrong: "✗" }[this.verdicts[item.key]] ?? "",
    };
    const { color } = paintOf(item, this.state.color, this.reasons);
    const swatch = make("i", { class: "swatch" });
    swatch.style.background = color;
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
