// Outlines of regions: parts, each an exterior and its holes, each ring a list of [x, y] in px of the photograph.
// A vertex is [part, ring, number]. Functions give new outlines and leave those that they get as they are.

import { boxOf } from "#report/geometry.js";

export const LEAST = 3; // vertices of a ring

/** The rings as flat arrays [x, y, x, y, ...], as panels paint them. */
export function flat(parts) {
  return parts.flatMap((part) => part.map((ring) => Float64Array.from(ring.flat())));
}

/** Area in square px, holes taken out. */
export function areaOf(parts) {
  const area = (ring) => {
    let sum = 0;
    ring.forEach(([x, y], k) => {
      const [u, v] = ring[(k + 1) % ring.length];
      sum += x * v - u * y;
    });
    return Math.abs(sum) / 2;
  };
  return parts.reduce((sum, [exterior, ...holes]) => sum + area(exterior) - holes.reduce((inner, hole) => inner + area(hole), 0), 0);
}

/** The box around all parts. */
export function boxOfParts(parts) {
  return boxOf(parts.flatMap(([exterior]) => exterior.flat()));
}

/** The vertex nearest to a point, if it is within `reach` px; else null. */
export function vertexNear(parts, [x, y], reach) {
  let best = null;
  each(parts, (ring, part, number) =>
    ring.forEach(([u, v], vertex) => {
      const distance = Math.hypot(u - x, v - y);
      if (distance <= reach && distance < (best?.distance ?? Infinity)) best = { distance, at: [part, number, vertex] };
    }),
  );
  return best?.at ?? null;
}

/** The edge nearest to a point, if it is within `reach` px: the place of a new vertex on it; else null. */
export function edgeNear(parts, [x, y], reach) {
  let best = null;
  each(parts, (ring, part, number) =>
    ring.forEach(([u, v], vertex) => {
      const [a, b] = ring[(vertex + 1) % ring.length];
      const length = (a - u) ** 2 + (b - v) ** 2;
      const along = length ? Math.max(0, Math.min(1, ((x - u) * (a - u) + (y - v) * (b - v)) / length)) : 0;
      const distance = Math.hypot(u + along * (a - u) - x, v + along * (b - v) - y);
      if (distance <= reach && distance < (best?.distance ?? Infinity)) best = { distance, at: [part, number, vertex + 1] };
    }),
  );
  return best?.at ?? null;
}

export function moved(parts, at, point) {
  return changed(parts, at, (ring, vertex) => ring.map((old, k) => (k === vertex ? point : old)));
}

export function inserted(parts, at, point) {
  return changed(parts, at, (ring, vertex) => ring.toSpliced(vertex, 0, point));
}

/** The same without a vertex; a ring of three keeps it. */
export function removed(parts, at) {
  return changed(parts, at, (ring, vertex) => (ring.length > LEAST ? ring.toSpliced(vertex, 1) : ring));
}

function changed(parts, [part, number, vertex], change) {
  return parts.map((rings, k) => (k === part ? rings.map((ring, n) => (n === number ? change(ring, vertex) : ring)) : rings));
}

function each(parts, visit) {
  parts.forEach((rings, part) => rings.forEach((ring, number) => visit(ring, part, number)));
}
