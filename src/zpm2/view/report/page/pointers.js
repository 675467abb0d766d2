// Mouse, pen and fingers on the photographs: point, choose, drag, pinch, wheel, and the curtain's edge.

const STILL = 4; // px that a click may move

/** report: has what is called here; `grab(side, point, event)`, where it has that, may take a press: it returns the
 * functions `move` and `up` of a point of the photograph, or null. scrolls: whether the wheel scrolls the page, and zooms
 * only with the control key, which a pinch on a touchpad is, too. */
export function pointers(report, scrolls = false) {
  report.panels.forEach((panel, side) => listen(report, panel, side, scrolls));
}

function listen(report, panel, side, scrolls) {
  const { element } = panel;
  const down = new Map(); // pointer id -> place
  let moved = 0;
  let edge = false;
  let grabbed = null;
  const place = (event) => {
    const box = element.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const hover = (at) => {
    const point = panel.toPhoto(at);
    const cursor = panel.holds(point) ? { side, point } : null;
    report.hover(cursor && panel.pick(point)?.item, cursor);
    element.classList.toggle("edge", panel.atEdge(at));
  };
  element.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    element.setPointerCapture(event.pointerId);
    down.set(event.pointerId, place(event));
    edge = down.size === 1 && panel.atEdge(place(event));
    grabbed = down.size === 1 ? (report.grab?.(side, panel.toPhoto(place(event)), event) ?? null) : null;
    moved = 0;
  });
  element.addEventListener("pointermove", (event) => {
    const at = place(event);
    const before = down.get(event.pointerId);
    if (!before) {
      hover(at);
      return;
    }
    const [dx, dy] = [at[0] - before[0], at[1] - before[1]];
    moved += Math.hypot(dx, dy);
    down.set(event.pointerId, at);
    if (grabbed) {
      grabbed.move(panel.toPhoto(at));
      return;
    }
    if (edge) panel.edge = Math.max(0.01, Math.min(0.99, at[0] / panel.width));
    else if (down.size === 2) pinch(event.pointerId, before, at);
    else if (moved > STILL) {
      panel.pan(dx, dy);
      element.classList.add("grab");
    }
    report.follow(panel);
  });
  const pinch = (id, before, at) => {
    const other = [...down].find(([key]) => key !== id)[1];
    const length = (point) => Math.max(1, Math.hypot(point[0] - other[0], point[1] - other[1]));
    panel.zoomAt(other, length(at) / length(before));
  };
  const up = (event) => {
    if (!down.delete(event.pointerId)) return;
    element.classList.remove("grab");
    if (grabbed) grabbed.up(panel.toPhoto(place(event)));
    else if (event.type === "pointerup" && moved <= STILL && !edge) {
      const point = panel.toPhoto(place(event));
      report.choose(panel.pick(point)?.item ?? null, { side, point, event });
    }
    edge = false;
    grabbed = null;
  };
  element.addEventListener("pointerup", up);
  element.addEventListener("pointercancel", up);
  element.addEventListener("pointerleave", () => report.hover(null));
  element.addEventListener("dblclick", () => report.zoomTo(report.chosen));
  element.addEventListener(
    "wheel",
    (event) => {
      if (scrolls && !event.ctrlKey) return;
      event.preventDefault();
      const lines = event.deltaMode === 1 ? 20 : 1;
      report.zoom(panel, place(event), Math.exp(-0.0015 * lines * event.deltaY));
      hover(place(event));
    },
    { passive: false },
  );
}
