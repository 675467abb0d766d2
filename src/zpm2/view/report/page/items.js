// What the page lists: matches, and polygons without a partner. Each is an item with its polygons.

import { boxOf, centerOf } from "#report/geometry.js";

export const STAGES = { global: "#0072b2", local: "#e69f00", guided: "#009e73", found: "#0072b2", "in part": "#e69f00" }; // Okabe and Ito's colours
export const CONFIDENCE = [ // from which confidence on, colour
  [0.9, "#4393ff"],
  [0.7, "#f4f1a5"],
  [0.5, "#fdb863"],
  [0, "#e66101"],
];
const PALE = "#d6d6d6";

export const WHY = {
  "outside overlap": "Less than half of its expected place lies in the other photograph, or has data there.",
  occluded: "Polygons with other partners cover most of its expected place: something stands in front of it.",
  "no candidate": "No polygon lies at its expected place, or that place is not known.",
  rejected: "A polygon lies at its expected place, but looks different, or is better matched with another one.",
};

/** [x, y, dx, dy, ...] in steps of a picture's px as Float32Array [x, y, x, y, ...] in px of the photograph. */
export function decodeRing(ring, steps, scale) {
  const found = new Float32Array(ring.length);
  let [x, y] = [0, 0];
  for (let k = 0; k < ring.length; k += 2) {
    x += ring[k];
    y += ring[k + 1];
    found[k] = x / steps / scale[0];
    found[k + 1] = y / steps / scale[1];
  }
  return found;
}

/** Items and the polygons of both sides (by side, in the order of the data) from the data of the page. */
export function itemsOf(data) {
  const polygons = data.sides.map((side, k) =>
    side.polygons.map((polygon) => {
      const rings = polygon.rings.map((ring) => decodeRing(ring, data.steps, data.scales[k]));
      const box = boxOf(rings[0]);
      return { ...polygon, side: k, rings, box, center: centerOf(box), item: null };
    }),
  );
  const byId = polygons.map((side) => new Map(side.map((polygon) => [polygon.id, polygon])));
  const items = data.matches.map((match) => {
    const pair = [byId[0].get(match.left), byId[1].get(match.right)];
    const label = pair[0].label ?? pair[1].label ?? "";
    return { ...match, key: `m${match.id}`, kind: "match", polygons: pair, area: pair[0].area, label, why: null };
  });
  polygons.forEach((side, k) => {
    const matched = new Set(items.map((item) => item.polygons[k]));
    for (const polygon of side) {
      if (matched.has(polygon)) continue;
      const kind = k ? "right" : "left";
      const pair = k ? [null, polygon] : [polygon, null];
      const { id, area, why } = polygon;
      const label = polygon.label ?? "";
      const nothing = { confidence: null, cost: null, dsf: null, stage: null, overlap: null, visible: null };
      items.push({ ...nothing, key: `${kind[0]}${id}`, id, kind, polygons: pair, area, label, why, color: PALE });
    }
  });
  for (const item of items) for (const polygon of item.polygons) if (polygon) polygon.item = item;
  return { items, polygons };
}

/** Whether the filters of a state let an item through. */
export function passes(item, state) {
  if (state.show === "matched" && item.kind !== "match") return false;
  if (state.show === "unmatched" && item.kind === "match") return false;
  if ((state.show === "left" || state.show === "right") && item.kind !== state.show) return false;
  if (state.hide.includes(item.stage ?? item.why)) return false;
  if (item.kind === "match" && (item.confidence < state.min || item.confidence > state.max)) return false;
  if (item.area < state.least || (state.most > 0 && item.area > state.most)) return false;
  const text = state.text.trim().toLowerCase();
  if (!text) return true;
  const ids = item.polygons.filter(Boolean).map((polygon) => String(polygon.id));
  const labels = item.polygons.filter(Boolean).map((polygon) => (polygon.label ?? "").toLowerCase());
  return ids.includes(text) || labels.some((label) => label.includes(text));
}

const KINDS = { match: 0, left: 1, right: 2 };

/** The items by a column; those without a value come last, equal ones by kind and id. By id, matches come first. */
export function sorted(items, column, down) {
  const value = (item) => (column === "stage" ? (item.stage ?? item.why) : item[column]);
  const sign = down ? -1 : 1;
  return [...items].sort((a, b) => {
    if (column === "id") return KINDS[a.kind] - KINDS[b.kind] || sign * (a.id - b.id);
    const [u, v] = [value(a) ?? "", value(b) ?? ""];
    if (u !== v) {
      if (u === "" || v === "") return u === "" ? 1 : -1;
      return sign * (u < v ? -1 : 1);
    }
    return KINDS[a.kind] - KINDS[b.kind] || a.id - b.id;
  });
}

/** The colour of an item, and whether it is filled, where colours show `mode`. */
export function paintOf(item, mode, reasons) {
  const matched = item.kind === "match";
  if (mode === "why") return matched ? { color: PALE, filled: false } : { color: reasons[item.why] ?? PALE, filled: true };
  if (!matched) return { color: PALE, filled: false };
  if (mode === "confidence") return { color: confidenceColor(item.confidence), filled: true };
  if (mode === "stage") return { color: STAGES[item.stage] ?? PALE, filled: true };
  return { color: item.color, filled: true };
}

/** The colour of a confidence. */
export function confidenceColor(confidence) {
  return (CONFIDENCE.find(([least]) => confidence >= least) ?? CONFIDENCE.at(-1))[1];
}

const NEAREST = 6; // matches that tell where a point should be

/** Where a point of one side should be on the other: moved and scaled as the nearest matches are, near ones most; null
 * without matches. */
export function expectedPlace(items, side, [x, y]) {
  const near = [];
  for (const { kind, polygons } of items) {
    if (kind !== "match") continue;
    const [here, there] = [polygons[side], polygons[1 - side]];
    const distance = (here.center[0] - x) ** 2 + (here.center[1] - y) ** 2;
    if (near.length === NEAREST && distance >= near[NEAREST - 1].distance) continue;
    near.push({ distance, here, there });
    near.sort((a, b) => a.distance - b.distance);
    near.length = Math.min(near.length, NEAREST);
  }
  if (!near.length) return null;
  const sum = [0, 0, 0, 0]; // x, y, logarithm of the factor, weight
  for (const { distance, here, there } of near) {
    const factor = Math.sqrt(there.area / here.area);
    const point = [0, 1].map((k) => there.center[k] + ([x, y][k] - here.center[k]) * factor);
    const weight = 1 / (1 + distance);
    [...point, Math.log(factor), 1].forEach((value, k) => (sum[k] += weight * value));
  }
  return { point: [sum[0] / sum[3], sum[1] / sum[3]], factor: Math.exp(sum[2] / sum[3]) };
}
