// One item close up: both chips side by side, its numbers, and the person's verdict.

import { closeUp, sizeOf } from "#report/closeup.js";
import { make, shown } from "#report/dom.js";
import { WHY, confidenceColor, expectedPlace } from "#report/items.js";

const [WIDTH, HEIGHT] = [199, 140]; // px of a chip

/** Writes an item into an element. page: {panels, items, verdicts, on: {verdict(item, verdict), select(key)}}. */
export function showDetail(element, item, page) {
  element.hidden = false;
  if (!item) {
    const hint = "Point at a polygon to see its partner. Click to keep it, double-click to zoom to it. Press ? for all keys.";
    element.replaceChildren(make("p", { class: "hint" }, hint), histogram(page.items));
    return;
  }
  const matched = item.kind === "match";
  const title = matched ? `Match ${item.id}` : `${item.kind === "left" ? "Left" : "Right"} polygon ${item.id}, not matched`;
  const parts = [
    make("h2", {}, title, item.label ? make("span", { class: "label" }, item.label) : null),
    make("div", { class: "chips" }, [0, 1].map((k) => chip(item, k, page))),
    matched ? numbers(item, page) : reason(item, page),
    matched && item.polygons[0].remark ? make("p", { class: "why" }, item.polygons[0].remark) : null,
    make("table", { class: "sides" }, sides(item, page)),
  ];
  element.replaceChildren(...parts.filter(Boolean));
}

/** How many matches have which confidence, in tenths. */
function histogram(items) {
  const counts = Array(10).fill(0);
  for (const { kind, confidence } of items) if (kind === "match") counts[Math.min(9, Math.floor(confidence * 10))]++;
  const most = Math.max(1, ...counts);
  const bars = counts.map((count, k) => {
    const bar = make("i", { title: `${shown(count)} with ${k / 10} to ${(k + 1) / 10}` });
    bar.style.height = `${(100 * count) / most}%`;
    bar.style.background = confidenceColor((k + 0.5) / 10);
    return make("span", {}, count ? make("small", {}, shown(count)) : null, bar);
  });
  return make("figure", { class: "histogram" }, make("div", {}, bars), make("figcaption", {}, make("span", {}, "0"), "matches by confidence", make("span", {}, "1")));
}

function numbers(item, page) {
  const values = [
    ["Confidence", shown(item.confidence, 2), "chance that the match is right"],
    ["Stage", item.stage, "what brought the pair in"],
    ["Cost ζ", shown(item.cost, 3), "lower is better"],
    ["DSF", shown(item.dsf), "homologous points inside both polygons"],
    ["Overlap", shown(item.overlap, 2), "IoU of the rectified left polygon with the right one"],
    ["Visible", shown(item.visible, 2), "share that both photographs can show"],
  ];
  const verdict = page.verdicts[item.key];
  const button = (name, text, key) =>
    make("button", { type: "button", class: name, "aria-pressed": verdict === name, title: `key ${key}`, onclick: () => page.on.verdict(item, name) }, text);
  return make(
    "div",
    {},
    make("dl", { class: "numbers" }, values.map(([name, value, title]) => make("div", { title }, make("dt", {}, name), make("dd", {}, value)))),
    make("div", { class: "verdict" }, button("right", "✓ Right", "y"), button("wrong", "✗ Wrong", "n")),
  );
}

function reason(item, page) {
  const swatch = make("i", { class: "swatch" });
  swatch.style.background = page.reasons[item.why] ?? "#aaa";
  return make("p", { class: "why" }, swatch, make("b", {}, item.why), ". ", item.polygons[0]?.remark ?? WHY[item.why] ?? "");
}

function sides(item, page) {
  const rows = [
    ["Label", (p) => p.label],
    ["Area", (p) => `${shown(p.area)} px²`],
    ["Score", (p) => shown(p.score, 2)],
    ["Inside", (p) => parentLink(p, page)],
  ].filter(([, of]) => item.polygons.some((p) => p && of(p) !== null));
  return [
    make("tr", {}, make("th", {}), make("th", { scope: "col" }, "Left"), make("th", { scope: "col" }, "Right")),
    rows.map(([name, of]) => make("tr", {}, make("th", { scope: "row" }, name), item.polygons.map((p) => make("td", {}, (p && of(p)) ?? "–")))),
  ];
}

function parentLink(polygon, page) {
  if (polygon.parent === null) return null;
  const parent = page.polygons[polygon.side].find((each) => each.id === polygon.parent);
  if (!parent) return String(polygon.parent);
  return make("button", { type: "button", class: "link", onclick: () => page.on.select(parent.item.key) }, String(parent.id));
}

/** One side of an item close up. page: {panels, items}. */
export function chip(item, side, page) {
  const panel = page.panels[side];
  const name = side ? "Right" : "Left";
  const canvas = make("canvas", { role: "img", "aria-label": `${name} close-up` });
  const polygon = item.polygons[side];
  const other = item.polygons[1 - side];
  const expected = polygon ? null : expectedPlace(page.items, 1 - side, other.center);
  const nothing = (text) => make("figure", { class: "chip none" }, make("figcaption", {}, text));
  if (!polygon && !expected) return nothing("expected place not known");
  if (!polygon && !panel.holds(expected.point)) return nothing("expected place beyond the border");
  const center = polygon ? polygon.center : expected.point;
  const extent = polygon ? sizeOf(polygon.box) : sizeOf(other.box).map((v) => v * expected.factor);
  closeUp(canvas, panel, [WIDTH, HEIGHT], center, extent, polygon);
  const caption = polygon ? `${name} ${polygon.id}` : `${name}: expected place, moved as the nearest matches`;
  return make("figure", { class: "chip" }, canvas, make("figcaption", {}, caption));
}
