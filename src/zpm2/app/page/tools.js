// What clicks and drags mean, by the tool: they become changes of regions.

import { edgeNear, inserted, LEAST, moved, removed, vertexNear } from "#app/outline.js";
import { regionOf, withBox, withOutline, withPoint } from "#app/regions.js";

export const TOOLS = ["point", "box", "outline", "edit"];
const REACH = 9; // screen px around a vertex or an edge
const SMALL = 4; // screen px; a smaller box is a slip

export class Tools {
  /** app: {tool, selected, panels, nextNumber(), change(region, side), preview(region), select(key), marks(), on: {say(text)}}. */
  constructor(app) {
    Object.assign(this, { app, sketch: null, box: null });
  }

  /** The selected region, or a new one. */
  target(side) {
    return this.app.selected ?? regionOf(this.app.nextNumber(), side);
  }

  /** Whether a press begins a drag of ours; see `pointers`. */
  grab(side, point, event) {
    if (this.app.tool === "box") return this.drawBox(side, point);
    return this.app.tool === "edit" ? this.dragVertex(side, point, event) : null;
  }

  drawBox(side, start) {
    const { app } = this;
    const limited = ([x, y]) => [Math.max(0, Math.min(app.panels[side].side.width, x)), Math.max(0, Math.min(app.panels[side].side.height, y))];
    const show = (point) => {
      this.box = { side, corners: [limited(start), limited(point)] };
      app.marks();
    };
    return {
      move: show,
      up: (point) => {
        this.box = null;
        const size = [0, 1].map((k) => Math.abs(limited(point)[k] - limited(start)[k]) * app.panels[side].view.zoom);
        if (Math.min(...size) >= SMALL) app.change(withBox(this.target(side), side, limited(start), limited(point)), side);
        else app.marks();
      },
    };
  }

  dragVertex(side, point, event) {
    const { app } = this;
    const region = app.selected;
    const parts = region?.shapes[side];
    if (!parts) return null;
    const reach = REACH / app.panels[side].view.zoom;
    let at = vertexNear(parts, point, reach);
    if (at && event.altKey) return { move: () => {}, up: () => app.change(withOutline(region, side, removed(parts, at)), side) };
    let before = parts;
    if (!at) {
      at = edgeNear(parts, point, reach);
      if (!at) return null;
      before = inserted(parts, at, point);
    }
    let now = null;
    return {
      move: (place) => {
        now = moved(before, at, place);
        app.preview(withOutline(region, side, now));
      },
      up: () => now && app.change(withOutline(region, side, now), side),
    };
  }

  /** A click; inside: whether its point is one of the region. */
  click(item, { side, point }, inside) {
    const { app } = this;
    if (!app.panels[side].holds(point)) return;
    if (app.tool === "edit") app.select(item?.key ?? "");
    else if (app.tool === "outline") this.addVertex(side, point);
    else if (app.tool === "point") {
      if (!inside && !app.selected) app.on.say("Click into a region first; then say what does not belong to it.");
      else app.change(withPoint(this.target(side), side, point, inside), side);
    }
  }

  addVertex(side, point) {
    if (this.sketch?.side !== side) this.sketch = { side, ring: [] };
    const { ring } = this.sketch;
    const zoom = this.app.panels[side].view.zoom;
    const closes = ring.length >= LEAST && Math.hypot(ring[0][0] - point[0], ring[0][1] - point[1]) * zoom < REACH;
    if (closes) this.close();
    else {
      this.sketch = { side, ring: [...ring, point] };
      this.app.marks();
    }
  }

  /** Closes the outline that is being drawn; false where there is none. */
  close() {
    if (!this.sketch) return false;
    const { side } = this.sketch;
    const ring = this.sketch.ring.filter(([x, y], k, all) => !k || x !== all[k - 1][0] || y !== all[k - 1][1]); // of a double click
    this.sketch = null;
    if (ring.length >= LEAST) this.app.change(withOutline(this.target(side), side, [[ring]]), side);
    else this.app.marks();
    return true;
  }

  /** Gives up what is being drawn; false where that is nothing. */
  cancel() {
    const had = this.sketch !== null;
    this.sketch = null;
    this.app.marks();
    return had;
  }
}
