// Tracks as the page lists them: items as of a pair, with a polygon (or null) for each photograph.

import { boxOf, centerOf } from "#report/geometry.js";
import { decodeRing } from "#report/items.js";

/** Items, and the polygons of each photograph, from the data of the page. The confidence of an item is its lowest. */
export function tracksOf(data) {
  const polygons = data.photographs.map(() => []);
  const items = data.tracks.map(({ id, color, closed, seen, absent }) => {
    const item = { key: `t${id}`, id, kind: "match", color, closed, absent, polygons: data.photographs.map(() => null) };
    for (const { photograph, rings, ...more } of seen) {
      const decoded = rings.map((ring) => decodeRing(ring, data.steps, data.photographs[photograph].scale));
      const box = boxOf(decoded[0]);
      const polygon = { ...more, id, photograph, rings: decoded, box, center: centerOf(box), item };
      item.polygons[photograph] = polygon;
      polygons[photograph].push(polygon);
    }
    item.seen = item.polygons.filter(Boolean);
    item.length = item.seen.length;
    item.confidence = Math.min(...item.seen.map((polygon) => polygon.confidence));
    item.area = item.seen[0].area;
    item.carried = item.seen.filter((polygon) => polygon.carried).length;
    return item;
  });
  return { items, polygons };
}

/** Whether the filters of a state let a track through. names: of the photographs. */
export function passes(item, state, names) {
  if (item.length < state.photographs || item.confidence < state.min || item.confidence > state.max) return false;
  if (state.carried && !item.carried) return false;
  const text = state.text.trim().toLowerCase();
  if (!text || String(item.id) === text) return true;
  return !/^\d+$/.test(text) && item.seen.some((polygon) => names[polygon.photograph].toLowerCase().includes(text));
}

const ORDERS = {
  length: (a, b) => b.length - a.length,
  weakest: (a, b) => a.confidence - b.confidence,
  area: (a, b) => b.area - a.area,
  id: () => 0,
};

/** The items in an order; equal ones by id. */
export function ordered(items, sort) {
  return [...items].sort((a, b) => ORDERS[sort](a, b) || a.id - b.id);
}

/** The tracks as rows of a CSV file. */
export function rowsOf(items, names) {
  const rows = items.map((item) => [
    item.id,
    item.length,
    item.confidence,
    item.carried,
    item.closed,
    item.seen.map((polygon) => names[polygon.photograph]).join(" "),
    item.absent.map(([row, why]) => `${names[row]}: ${why}`).join("; "),
  ]);
  return [["track", "photographs", "lowest_confidence", "carried", "closed", "seen", "absent"], ...rows];
}
