// Plane geometry of the page: points [x, y], matrices as three rows, boxes [x0, y0, x1, y1].

/** A 3 x 3 matrix times a vector. For the epipolar line [a, b, c], a x + b y + c = 0, of a homogeneous point. */
export function multiply(matrix, vector) {
  return matrix.map((row) => row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2]);
}

export function transposed(matrix) {
  return [0, 1, 2].map((k) => matrix.map((row) => row[k]));
}

/** The part of the line a x + b y + c = 0 inside of a box: its two ends, or null where it misses the box. */
export function clipLine([a, b, c], [x0, y0, x1, y1]) {
  const ends = [];
  const add = (x, y) => {
    const inside = x >= x0 - 1e-9 && x <= x1 + 1e-9 && y >= y0 - 1e-9 && y <= y1 + 1e-9;
    if (inside && !ends.some((end) => Math.hypot(end[0] - x, end[1] - y) < 1e-6)) ends.push([x, y]);
  };
  if (b !== 0) for (const x of [x0, x1]) add(x, -(a * x + c) / b);
  if (a !== 0) for (const y of [y0, y1]) add(-(b * y + c) / a, y);
  return ends.length >= 2 ? [ends[0], ends[1]] : null;
}

/** Whether a point lies inside of rings (flat arrays x, y, x, y, ...): an odd number of them winds around it. */
export function inside(rings, x, y) {
  let odd = false;
  for (const ring of rings) {
    for (let k = 0, before = ring.length - 2; k < ring.length; before = k, k += 2) {
      const [ax, ay, bx, by] = [ring[before], ring[before + 1], ring[k], ring[k + 1]];
      if (ay > y !== by > y && x < ((bx - ax) * (y - ay)) / (by - ay) + ax) odd = !odd;
    }
  }
  return odd;
}

/** The box around a ring. */
export function boxOf(ring) {
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  for (let k = 0; k < ring.length; k += 2) {
    box[0] = Math.min(box[0], ring[k]);
    box[1] = Math.min(box[1], ring[k + 1]);
    box[2] = Math.max(box[2], ring[k]);
    box[3] = Math.max(box[3], ring[k + 1]);
  }
  return box;
}

export function centerOf(box) {
  return [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2];
}

/** Boxes by the cells of a grid that they touch, so that a point has to be compared with few of them. */
export class Grid {
  constructor(boxes, width, height) {
    this.count = Math.max(1, Math.min(128, Math.ceil(Math.sqrt(boxes.length))));
    this.size = [width / this.count, height / this.count];
    this.cells = Array.from({ length: this.count ** 2 }, () => []);
    boxes.forEach((box, index) => {
      const [i0, j0] = this.cell(box[0], box[1]);
      const [i1, j1] = this.cell(box[2], box[3]);
      for (let j = j0; j <= j1; j++) for (let i = i0; i <= i1; i++) this.cells[j * this.count + i].push(index);
    });
  }

  cell(x, y) {
    return [x / this.size[0], y / this.size[1]].map((v) => Math.max(0, Math.min(this.count - 1, Math.floor(v))));
  }

  /** The numbers of the boxes that may hold a point. */
  near(x, y) {
    const [i, j] = this.cell(x, y);
    return this.cells[j * this.count + i];
  }
}
