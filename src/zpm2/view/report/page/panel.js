// One photograph with its polygons, on three canvases: the picture; all polygons; what moves with the cursor.
//
// Thousands of polygons take longer to paint than a frame lasts. While the view moves, their canvas is moved as a whole
// by the browser, and painted again when the view rests.

import { Grid, inside } from "#report/geometry.js";
import { paintOf } from "#report/items.js";

const MARGIN = 0.02; // of the panel, around a photograph that is shown whole
const MANY = 600; // polygons in sight that are not painted again at once while the view moves
const PALE = 200; // outlines of polygons that are not coloured; more are fainter
const DOT = 3; // screen px, the longer side of a polygon that is painted as a box
const DEEPEST = 64; // screen px per px of the photograph
const ENLARGED = 6; // screen px per px of the picture, when zooming to a polygon
const LABEL = 13; // px, height of the numbers
const HANDLE = 14; // px on either side of the curtain's edge, where it can be taken

export class Panel {
  /** element: of the page, gets the canvases. picture: an image of the whole photograph. tiles: of a large one. */
  constructor(element, side, picture, tiles, polygons, name) {
    Object.assign(this, { element, side, picture, tiles });
    [this.photo, this.shapes, this.top] = ["photo", "shapes", "top"].map((kind) => {
      const canvas = document.createElement("canvas");
      canvas.className = kind;
      element.append(canvas);
      return canvas;
    });
    this.top.setAttribute("role", "img");
    this.top.setAttribute("aria-label", name);
    this.over = null; // a picture over this one, and the share of the panel's width from which on it is shown
    this.edge = 0.5;
    this.view = { zoom: 1, x: 0, y: 0 }; // screen px = zoom * px of the photograph + (x, y)
    this.whole = true;
    this.hold(polygons);
  }

  /** Takes other polygons. */
  hold(polygons) {
    this.order = [...polygons].sort((a, b) => b.area - a.area || a.id - b.id);
    this.order.forEach((polygon) => (polygon.path ??= pathOf(polygon.rings)));
    this.grid = new Grid(this.order.map((polygon) => polygon.box), this.side.width, this.side.height);
  }

  resize() {
    const { width, height } = this.element.getBoundingClientRect();
    this.ratio = window.devicePixelRatio || 1;
    [this.width, this.height] = [Math.max(1, width), Math.max(1, height)];
    for (const canvas of [this.photo, this.shapes, this.top]) {
      canvas.width = Math.round(this.width * this.ratio);
      canvas.height = Math.round(this.height * this.ratio);
    }
    if (this.whole) this.fit();
  }

  fit() {
    const zoom = Math.min(this.width / this.side.width, this.height / this.side.height) * (1 - 2 * MARGIN);
    this.view = { zoom, x: (this.width - zoom * this.side.width) / 2, y: (this.height - zoom * this.side.height) / 2 };
    this.whole = true;
  }

  get least() {
    return 0.9 * Math.min(this.width / this.side.width, this.height / this.side.height);
  }

  /** Zooms around a place of the screen, which keeps its pixel. */
  zoomAt([sx, sy], factor) {
    const { zoom, x, y } = this.view;
    const next = Math.max(this.least, Math.min(DEEPEST, zoom * factor));
    this.look(next, sx - ((sx - x) * next) / zoom, sy - ((sy - y) * next) / zoom);
  }

  pan(dx, dy) {
    this.look(this.view.zoom, this.view.x + dx, this.view.y + dy);
  }

  /** Shows a point of the photograph in the middle of the panel. */
  center([px, py], zoom = this.view.zoom) {
    zoom = Math.max(this.least, Math.min(DEEPEST, zoom));
    this.look(zoom, this.width / 2 - zoom * px, this.height / 2 - zoom * py);
  }

  /** Sets the view; the photograph fills the panel where it is large enough, else it stays in the middle. */
  look(zoom, x, y) {
    const kept = (at, length, panel) => (length < panel ? (panel - length) / 2 : Math.max(panel - length, Math.min(0, at)));
    this.view = { zoom, x: kept(x, zoom * this.side.width, this.width), y: kept(y, zoom * this.side.height, this.height) };
    this.whole = false;
  }

  /** Px of the sharpest picture per px of the photograph. */
  get sharpness() {
    return this.tiles && !this.tiles.missing ? 1 : this.picture.naturalWidth / this.side.width;
  }

  /** The zoom at which a box fills half of the panel, as far as the picture has the pixels for it. */
  zoomOf(box) {
    const half = 0.5 * Math.min(this.width / (box[2] - box[0]), this.height / (box[3] - box[1]));
    return Math.min(half, ENLARGED * this.sharpness);
  }

  toPhoto([sx, sy]) {
    return [(sx - this.view.x) / this.view.zoom, (sy - this.view.y) / this.view.zoom];
  }

  middle() {
    return this.toPhoto([this.width / 2, this.height / 2]);
  }

  holds([px, py]) {
    return px >= 0 && py >= 0 && px <= this.side.width && py <= this.side.height;
  }

  atEdge([sx]) {
    return this.over !== null && this.edge > 0 && this.edge < 1 && Math.abs(sx - this.edge * this.width) < HANDLE;
  }

  /** The smallest shown polygon at a point of the photograph, or null. */
  pick([px, py]) {
    let best = null;
    for (const index of this.grid.near(px, py)) {
      const polygon = this.order[index];
      const [x0, y0, x1, y1] = polygon.box;
      if (!polygon.shown || px < x0 || px > x1 || py < y0 || py > y1 || (best && best.area <= polygon.area)) continue;
      if (inside(polygon.rings, px, py)) best = polygon;
    }
    return best;
  }

  context(canvas) {
    // The browser then paints without a GPU, which takes seconds for thousands of paths where it is emulated.
    const context = canvas.getContext("2d", { willReadFrequently: canvas === this.shapes });
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, canvas.width, canvas.height);
    return context;
  }

  toPhotoUnits(context) {
    const { zoom, x, y } = this.view;
    context.setTransform(this.ratio * zoom, 0, 0, this.ratio * zoom, this.ratio * x, this.ratio * y);
  }

  paintPhoto() {
    const context = this.context(this.photo);
    this.toPhotoUnits(context);
    context.imageSmoothingEnabled = this.view.zoom < 4 * this.sharpness;
    context.imageSmoothingQuality = "high";
    const { width, height } = this.side;
    if (!this.over || this.edge > 0) context.drawImage(this.picture, 0, 0, width, height);
    if (!this.over) this.tiles?.draw(context, this.sight(), this.view.zoom * this.ratio);
    if (this.over && this.edge < 1) this.paintOver(context);
  }

  /** The box of the photograph that is in sight. */
  sight() {
    return [...this.toPhoto([0, 0]), ...this.toPhoto([this.width, this.height])];
  }

  /** The polygons in sight, largest first. */
  seen() {
    const [x0, y0, x1, y1] = this.sight();
    return this.order.filter((p) => p.shown && p.box[0] < x1 && p.box[2] > x0 && p.box[1] < y1 && p.box[3] > y0);
  }

  /** Moves the painted polygons with the view; false where there are few, which are better painted again. */
  moveShapes() {
    if (!this.crowded || !this.painted) return false;
    const [from, to] = [this.painted, this.view];
    const factor = to.zoom / from.zoom;
    this.shapes.style.transform = `translate(${to.x - from.x * factor}px, ${to.y - from.y * factor}px) scale(${factor})`;
    return true;
  }

  paintShapes(state, reasons) {
    const context = this.context(this.shapes);
    this.shapes.style.transform = "";
    this.toPhotoUnits(context);
    const seen = this.seen();
    const { zoom } = this.view;
    [this.painted, this.crowded] = [this.view, seen.length > MANY];
    context.lineJoin = "round";
    const alone = seen.filter((polygon) => !paintOf(polygon.item, state.color, reasons).filled).length;
    const pale = Math.max(0.2, 0.6 * Math.sqrt(Math.min(1, PALE / (alone + 1)))); // many outlines are fainter
    for (const filled of [false, true]) {
      for (const polygon of seen) {
        const paint = paintOf(polygon.item, state.color, reasons);
        if (paint.filled !== filled) continue;
        context.strokeStyle = context.fillStyle = paint.color;
        const [x0, y0, x1, y1] = polygon.box;
        if (Math.max(x1 - x0, y1 - y0) * zoom < DOT) {
          context.fillRect(x0, y0, x1 - x0, y1 - y0);
          continue;
        }
        if (filled && state.fill > 0) {
          context.globalAlpha = state.fill / 100;
          context.fill(polygon.path, "evenodd");
        }
        context.globalAlpha = filled ? 1 : pale;
        context.lineWidth = (filled ? 1.6 : 0.8) / zoom;
        context.stroke(polygon.path);
      }
    }
    context.globalAlpha = 1;
    if (state.numbers) this.paintNumbers(context, seen, state, reasons);
  }

  paintOver(context) {
    const { width, height } = this.side;
    context.save();
    const from = (this.edge * this.width - this.view.x) / this.view.zoom;
    context.beginPath();
    context.rect(Math.max(from, 0), 0, width, height);
    context.clip();
    context.fillStyle = "#333";
    context.fillRect(0, 0, width, height);
    context.drawImage(this.over, 0, 0, width, height);
    context.restore();
  }

  paintNumbers(context, seen, state, reasons) {
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    context.font = `600 ${LABEL}px system-ui, sans-serif`;
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.lineWidth = 3;
    context.strokeStyle = "rgba(0, 0, 0, 0.75)";
    context.fillStyle = "#fff";
    const taken = [];
    const { zoom, x, y } = this.view;
    for (const polygon of [...seen].reverse()) { // small ones first: they have no other place
      if (!paintOf(polygon.item, state.color, reasons).filled) continue;
      const text = String(polygon.item.id);
      const [w, h] = [(polygon.box[2] - polygon.box[0]) * zoom, (polygon.box[3] - polygon.box[1]) * zoom];
      if (w < 8 * text.length + 6 || h < LABEL + 4) continue;
      polygon.spot ??= spotOf(polygon);
      const [sx, sy] = [polygon.spot[0] * zoom + x, polygon.spot[1] * zoom + y];
      const half = 4 * text.length + 2;
      if (taken.some(([tx, ty, other]) => Math.abs(sy - ty) < LABEL && Math.abs(sx - tx) < half + other)) continue;
      taken.push([sx, sy, half]);
      context.strokeText(text, sx, sy);
      context.fillText(text, sx, sy);
    }
  }

  /** marks: {polygons: [{polygon, color, strong}], line: ends or null, spot: point or null}. */
  paintTop({ polygons, line, spot }) {
    const context = this.context(this.top);
    this.toPhotoUnits(context);
    context.lineJoin = "round";
    const { zoom } = this.view;
    for (const { polygon, color, strong } of polygons) {
      context.globalAlpha = strong ? 0.35 : 0.15;
      context.fillStyle = color;
      context.fill(polygon.path, "evenodd");
      context.globalAlpha = 1;
      for (const [width, paint] of [[6, "#000"], [4, "#fff"], [2, color]]) {
        context.lineWidth = width / zoom;
        context.strokeStyle = paint;
        context.stroke(polygon.path);
      }
    }
    for (const [width, paint] of [[4, "rgba(0, 0, 0, 0.7)"], [1.6, "#ffe14d"]]) {
      context.lineWidth = width / zoom;
      context.strokeStyle = paint;
      context.beginPath();
      if (line) {
        context.moveTo(...line[0]);
        context.lineTo(...line[1]);
      }
      if (spot) {
        const arm = 8 / zoom;
        for (const [dx, dy] of [[arm, 0], [0, arm]]) {
          context.moveTo(spot[0] - dx, spot[1] - dy);
          context.lineTo(spot[0] + dx, spot[1] + dy);
        }
      }
      context.stroke();
    }
    if (this.over && this.edge > 0 && this.edge < 1) this.paintEdge(context);
  }

  paintEdge(context) {
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    const at = this.edge * this.width;
    context.fillStyle = "#fff";
    context.shadowBlur = 4;
    context.shadowColor = "#000";
    context.fillRect(at - 1, 0, 2, this.height);
    context.beginPath();
    context.arc(at, this.height / 2, 11, 0, 2 * Math.PI);
    context.fill();
    context.shadowBlur = 0;
    context.fillStyle = "#222";
    context.font = "700 13px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillText("⇔", at, this.height / 2);
  }
}

/** Rings as a path. */
export function pathOf(rings) {
  const path = new Path2D();
  for (const ring of rings) {
    path.moveTo(ring[0], ring[1]);
    for (let k = 2; k < ring.length; k += 2) path.lineTo(ring[k], ring[k + 1]);
    path.closePath();
  }
  return path;
}

/** A place inside of a polygon for its number: the middle of its longest inside stretch on some lines through it. */
export function spotOf({ rings, box, center }) {
  let best = center;
  let longest = 0;
  for (const share of [0.5, 0.35, 0.65, 0.2, 0.8]) {
    const y = box[1] + share * (box[3] - box[1]);
    const cuts = [];
    for (const ring of rings) {
      for (let k = 0, before = ring.length - 2; k < ring.length; before = k, k += 2) {
        const [ay, by] = [ring[before + 1], ring[k + 1]];
        if (ay > y !== by > y) cuts.push(ring[before] + ((ring[k] - ring[before]) * (y - ay)) / (by - ay));
      }
    }
    cuts.sort((a, b) => a - b);
    for (let k = 0; k + 1 < cuts.length; k += 2) {
      if (cuts[k + 1] - cuts[k] > longest * 1.2) [longest, best] = [cuts[k + 1] - cuts[k], [(cuts[k] + cuts[k + 1]) / 2, y]];
    }
  }
  return best;
}
