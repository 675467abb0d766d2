// A photograph with regions, and over them what the person is drawing.

import { Panel } from "#report/panel.js";

const POINT = 6; // screen px, radius of a point of a prompt
const HANDLE = 3.5; // screen px, half the side of a vertex
const ROOM = 11; // screen px between two vertices that are both shown
const [INSIDE, OUTSIDE, DRAWN] = ["#19a974", "#e7040f", "#ffe14d"];

export class Canvas extends Panel {
  /** marks: those of `Panel.paintTop`, and prompt: {points, box} or null, sketch: [[x, y], ...] of an outline that is not
   * closed yet or null, box: [[x, y], [x, y]] that is being drawn or null, vertices: parts or null. */
  paintTop(marks) {
    super.paintTop(marks);
    const context = this.top.getContext("2d");
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    const screen = ([x, y]) => [x * this.view.zoom + this.view.x, y * this.view.zoom + this.view.y];
    const { prompt, sketch, box, vertices } = marks;
    if (prompt?.box) this.paintBox(context, screen(prompt.box.slice(0, 2)), screen(prompt.box.slice(2)));
    if (box) this.paintBox(context, ...box.map(screen));
    for (const ring of vertices?.flat() ?? []) this.paintVertices(context, ring.map(screen));
    if (sketch) {
      const places = sketch.map(screen);
      twice(context, () => {
        context.beginPath();
        places.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
        context.stroke();
      });
      places.slice(0, -1).forEach((place) => this.paintVertex(context, place));
    }
    for (const [x, y, inside] of prompt?.points ?? []) this.paintPoint(context, screen([x, y]), inside);
  }

  paintBox(context, [x0, y0], [x1, y1]) {
    context.setLineDash([6, 4]);
    twice(context, () => context.strokeRect(x0, y0, x1 - x0, y1 - y0));
    context.setLineDash([]);
  }

  /** Those that have room: zooming in shows the others. */
  paintVertices(context, ring) {
    let last = [-Infinity, -Infinity];
    for (const place of ring) {
      if (Math.hypot(place[0] - last[0], place[1] - last[1]) < ROOM) continue;
      this.paintVertex(context, place);
      last = place;
    }
  }

  paintVertex(context, [x, y]) {
    context.fillStyle = "#fff";
    context.strokeStyle = "#000";
    context.lineWidth = 1;
    context.fillRect(x - HANDLE, y - HANDLE, 2 * HANDLE, 2 * HANDLE);
    context.strokeRect(x - HANDLE, y - HANDLE, 2 * HANDLE, 2 * HANDLE);
  }

  /** A plus in green, or a minus in red. */
  paintPoint(context, [x, y], inside) {
    context.beginPath();
    context.arc(x, y, POINT, 0, 2 * Math.PI);
    context.fillStyle = inside ? INSIDE : OUTSIDE;
    context.fill();
    context.strokeStyle = "#fff";
    context.lineWidth = 2;
    context.stroke();
    context.beginPath();
    context.moveTo(x - 3, y);
    context.lineTo(x + 3, y);
    if (inside) {
      context.moveTo(x, y - 3);
      context.lineTo(x, y + 3);
    }
    context.stroke();
  }
}

/** A yellow line on a dark one, which is seen on any photograph. */
function twice(context, stroke) {
  for (const [width, color] of [[4, "rgba(0, 0, 0, 0.7)"], [1.8, DRAWN]]) {
    context.lineWidth = width;
    context.strokeStyle = color;
    stroke();
  }
}
