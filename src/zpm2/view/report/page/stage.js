// Both photographs side by side, or one: where they are, how they zoom together, and when they are painted.

import { the } from "#report/dom.js";
import { expectedPlace } from "#report/items.js";

const REST = 120; // ms without a move

/** What extends it has `panels`, `state` (mode, link, and what `Panel.paintShapes` needs), `reasons`, the `items` that
 * tell where a place of one photograph is in the other, and `marks()`, which paints what moves with the cursor. */
export class Stage {
  layout() {
    const stage = the("stage");
    const one = this.state.mode !== "side";
    const { width, height } = stage.getBoundingClientRect();
    const [a, b] = this.panels.map((panel) => panel.side);
    const scale = (w, h) => Math.min(w / a.width, h / a.height) + Math.min(w / b.width, h / b.height);
    const row = scale(width / 2, height) >= scale(width, height / 2);
    stage.className = one ? "one" : row ? "row" : "column";
    the("panel-right").hidden = one;
    this.panels.slice(0, one ? 1 : 2).forEach((panel) => panel.resize());
    this.refresh(true);
  }

  fit() {
    this.panels.forEach((panel) => panel.fit());
    this.refresh();
  }

  /** Zooms one photograph; the other one follows. */
  zoom(panel, place, factor) {
    panel.zoomAt(place, factor);
    this.follow(panel);
  }

  follow(panel) {
    if (this.state.link && this.state.mode === "side") {
      const k = this.panels.indexOf(panel);
      const other = this.panels[1 - k];
      const there = expectedPlace(this.items, k, panel.middle());
      if (panel.whole) other.fit();
      else if (there) other.center(there.point, panel.view.zoom / there.factor);
    }
    this.refresh();
  }

  /** Paints again, once before the next frame. shapes: the polygons have changed; else the view may have moved. */
  refresh(shapes = false) {
    this.changed ||= shapes;
    this.due ??= requestAnimationFrame(() => {
      this.due = null;
      for (const panel of this.panels) {
        if (!panel.width || panel.element.hidden) continue;
        panel.paintPhoto();
        if (panel.view === panel.painted && !this.changed) continue;
        if (this.changed || !panel.moveShapes()) panel.paintShapes(this.state, this.reasons);
        else this.settle();
      }
      this.changed = false;
      this.marks();
      document.documentElement.dataset.ready ??= String(Math.round(performance.now()));
    });
  }

  /** Paints the polygons when the view has come to rest. */
  settle() {
    clearTimeout(this.resting);
    this.resting = setTimeout(() => this.refresh(true), REST);
  }
}
