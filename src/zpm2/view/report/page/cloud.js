// The page of a polygon cloud.

import { make, shown, the } from "#report/dom.js";
import { CONFIDENCE, confidenceColor } from "#report/items.js";
import { moved, nearer, seenFrom, spun } from "#report/orbit.js";
import { Scene, placesOf } from "#report/scene.js";
import { connectKeys, connectReset, connectState, keepAddress, otherTheme, showState, stepped } from "#report/shell.js";
import { CLOUD, fromFragment, toFragment } from "#report/state.js";
import { Table, filled } from "#report/table.js";

const STILL = 4; // px that a click may move
const TURN = 0.008; // radians per px
const STEP = 0.15; // radians per key
const CLOSE = 2.2; // sizes of a polygon, the distance from which it is seen close up

const COLUMNS = [
  ["id", "Id", "number of the polygon", (item) => String(item.id), "64px"],
  ["label", "Label", "label of the polygon", (item) => item.label ?? "", "minmax(70px, 1fr)"],
  ["area", "Area", "in units of the surface, squared", (item) => short(item.area), "minmax(70px, 1fr)"],
  ["confidence", "Conf.", "highest confidence of its matches", (item) => shown(item.confidence, 2), "54px"],
  ["planarity", "Planarity", "1 on a plane, 0 where it extends equally in all directions", (item) => shown(item.planarity, 2), "72px"],
  ["seen", "Views", "photographs that see it", (item) => shown(item.views.length), "50px"],
];

/** A number of any size as a person reads it. */
function short(value) {
  const odd = Math.abs(value) >= 1e5 || (value && Math.abs(value) < 1e-3);
  return odd ? value.toExponential(3) : String(Number(value.toPrecision(5)));
}

class CloudPage {
  constructor(data) {
    this.data = data;
    this.items = data.polygons.map((polygon, number) => ({ ...polygon, number, key: `p${polygon.id}`, kind: "match", seen: polygon.views.length, color: `rgb(${polygon.rgb})` }));
    this.byKey = new Map(this.items.map((item) => [item.key, item]));
    this.state = fromFragment(location.hash, CLOUD);
    this.hovered = null;
    this.home = { yaw: 0, pitch: -0.2, distance: data.distance, target: [0, 0, 0] };
    this.eye = this.home;
    this.table = new Table(the("table-head"), the("table-body"), filled(COLUMNS, this.items), {
      sort: (column) => this.set({ sort: column, down: this.state.sort === column && !this.state.down }),
      select: (item) => this.choose(item),
      hover: (item) => this.hover(item),
      color: (item) => this.colorOf(item),
    });
  }

  start() {
    const canvas = the("view");
    try {
      this.scene = new Scene(canvas, this.data.parts, this.items.length);
      this.places = placesOf(this.data.parts.find(({ name }) => name === "patches"), this.items.length);
    } catch (error) {
      the("no-compare").hidden = false;
      if (error.message !== "no WebGL 2") the("no-compare").textContent = `WebGL: ${error.message}`;
    }
    this.connect();
    if (this.scene) {
      this.listen(canvas);
      new ResizeObserver(() => this.draw()).observe(canvas);
      canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
      canvas.addEventListener("webglcontextrestored", () => {
        this.scene.start();
        this.draw();
      });
    }
    addEventListener("hashchange", () => this.adopt(fromFragment(location.hash, CLOUD)));
    this.adopt(this.state);
    this.drawNow();
    const asked = location.hash.match(/^#pick=([\d.]+),([\d.]+)$/); // shares of the width and the height
    if (asked && this.scene) this.hover(this.pick(asked[1] * canvas.width, asked[2] * canvas.height));
    document.documentElement.dataset.ready = "yes";
  }

  connect() {
    const set = (changes) => this.set(changes);
    connectState(CLOUD, set);
    connectReset(CLOUD, ["text", "min"], set);
    the("theme").addEventListener("click", () => this.turnTheme());
    the("fit").addEventListener("click", () => this.look(this.home));
    connectKeys({
      ArrowLeft: () => this.look(spun(this.eye, -STEP, 0)),
      ArrowRight: () => this.look(spun(this.eye, STEP, 0)),
      ArrowDown: () => this.step(1),
      ArrowUp: () => this.step(-1),
      j: () => this.step(1),
      k: () => this.step(-1),
      Enter: () => this.closeUp(this.chosen),
      Escape: () => this.choose(null),
      "+": () => this.look(nearer(this.eye, 1.25)),
      "-": () => this.look(nearer(this.eye, 0.8)),
      0: () => this.look(this.home),
      r: () => this.look(this.home),
      c: () => this.set({ color: this.state.color === "match" ? "confidence" : "match" }),
      d: () => this.turnTheme(),
      "/": () => document.querySelector('[data-state="text"]').focus(),
    });
  }

  listen(canvas) {
    const down = new Map(); // pointer id -> place
    let far = 0;
    const place = (event) => [event.clientX, event.clientY];
    const unit = () => (2 * Math.tan(this.data.opening / 2) * this.eye.distance) / canvas.clientHeight; // per px, at the target
    const pan = (dx, dy) => this.look(moved(this.data.frame, this.eye, dx * unit(), -dy * unit()));
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      down.set(event.pointerId, place(event));
      far = 0;
    });
    canvas.addEventListener("pointermove", (event) => {
      const at = place(event);
      const before = down.get(event.pointerId);
      if (!before) {
        this.hover(this.under(event));
        return;
      }
      const [dx, dy] = [at[0] - before[0], at[1] - before[1]];
      far += Math.abs(dx) + Math.abs(dy);
      down.set(event.pointerId, at);
      if (down.size === 2) {
        const other = [...down].find(([id]) => id !== event.pointerId)[1];
        const length = (point) => Math.max(1, Math.hypot(point[0] - other[0], point[1] - other[1]));
        this.eye = nearer(this.eye, length(at) / length(before));
        pan(dx / 2, dy / 2);
      } else if (event.shiftKey || event.buttons & 2) pan(dx, dy);
      else this.look(spun(this.eye, dx * TURN, -dy * TURN));
    });
    const up = (event) => {
      if (!down.delete(event.pointerId)) return;
      if (event.type === "pointerup" && event.button === 0 && far <= STILL) this.choose(this.under(event));
    };
    canvas.addEventListener("pointerup", up);
    canvas.addEventListener("pointercancel", up);
    canvas.addEventListener("pointerleave", () => this.hover(null));
    canvas.addEventListener("dblclick", () => this.closeUp(this.chosen));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        this.look(nearer(this.eye, Math.exp(-0.0012 * event.deltaY * (event.deltaMode === 1 ? 20 : 1))));
      },
      { passive: false },
    );
  }

  under(event) {
    const box = the("view").getBoundingClientRect();
    const ratio = the("view").width / Math.max(box.width, 1);
    return this.pick((event.clientX - box.left) * ratio, (event.clientY - box.top) * ratio);
  }

  pick(x, y) {
    return this.items[this.scene.pick(this.view, this.state, x, y)] ?? null;
  }

  get view() {
    const { width, height } = the("view");
    return seenFrom(this.data.frame, this.eye, this.data.opening, Math.max(width / height, 1e-6));
  }

  look(eye) {
    this.eye = eye;
    this.draw();
  }

  /** Turns around a polygon from now on, near enough to see it well. */
  closeUp(item) {
    const place = item && this.places?.[item.number];
    if (place) this.look({ ...this.eye, target: place.center, distance: Math.min(8, Math.max(0.05, CLOSE * place.size)) });
  }

  set(changes) {
    this.adopt({ ...this.state, ...changes });
    keepAddress(toFragment(this.state, CLOUD));
  }

  adopt(state) {
    this.state = state;
    showState(state);
    const through = this.items.filter((item) => this.passes(item));
    this.listed = sortedBy(through, state.sort, state.down);
    the("listed").textContent = `${shown(this.listed.length)} of ${shown(this.items.length)} polygons shown`;
    this.table.show(this.listed, state);
    this.table.reveal(state.select);
    if (this.scene) {
      const seen = new Set(through);
      this.scene.dress(this.items.map((item) => (!seen.has(item) ? null : state.color === "match" ? true : rgbOf(confidenceColor(item.confidence)))));
    }
    the("legend").replaceChildren(...(state.color === "match" ? [] : CONFIDENCE.map(([least, color]) => make("span", {}, swatch(color), least ? `from ${least}` : "less"))));
    this.mark();
  }

  passes(item) {
    const text = this.state.text.trim().toLowerCase();
    if (item.confidence < this.state.min) return false;
    if (!text || String(item.id) === text) return true;
    return [item.label ?? "", ...item.views.map((k) => this.data.views[k])].some((name) => name.toLowerCase().includes(text));
  }

  colorOf(item) {
    return this.state.color === "match" ? item.color : confidenceColor(item.confidence);
  }

  choose(item) {
    this.set({ select: item && item.key !== this.state.select ? item.key : "" });
  }

  step(rows) {
    const next = stepped(this.listed, this.state.select, rows);
    if (next) this.set({ select: next.key });
  }

  hover(item) {
    if (item === this.hovered) return;
    this.hovered = item;
    this.mark();
  }

  get chosen() {
    return this.byKey.get(this.state.select) ?? null;
  }

  turnTheme() {
    this.set({ theme: otherTheme(this.state) });
  }

  mark() {
    this.table.mark(this.hovered?.key, this.state.select);
    const item = this.hovered ?? this.chosen;
    document.body.dataset.picked = item ? item.number : -1;
    showPolygon(the("detail"), item, this.data);
    this.draw();
  }

  draw() {
    this.due ??= requestAnimationFrame(() => this.drawNow());
  }

  drawNow() {
    this.due = null;
    if (!this.scene) return;
    this.scene.resize();
    this.scene.paint(this.view, this.state, this.hovered?.number ?? -1, this.chosen?.number ?? -1);
  }
}

function showPolygon(element, item, { views, events }) {
  if (!item) {
    element.replaceChildren(make("p", { class: "hint" }, "Point at a polygon to see what is known of it. Click to keep it, double-click to turn around it. Press ? for all keys."));
    return;
  }
  const rows = [
    ["Area", short(item.area)],
    ["Boundary", short(item.length)],
    ["Confidence", shown(item.confidence, 3)],
    ["Planarity", shown(item.planarity, 4)],
    ["Curvature", short(item.curvature)],
    ["Normal", item.normal.map((x) => x.toFixed(2)).join(", ")],
    ["Share lifted", `${shown(100 * item.scale ** 2)} %`],
    ["Part of", item.parent ?? "–"],
    ...events.filter(({ whole }) => whole === item.id).map((e) => [`Whole in ${views[e.whole_in]}`, `polygons ${e.parts.join(", ")} in ${views[e.parts_in]}`]),
    ...events.filter(({ parts }) => parts.includes(item.id)).map((e) => [`Part in ${views[e.parts_in]}`, `of polygon ${e.whole}, whole in ${views[e.whole_in]}`]),
    ["Seen by", item.views.map((k) => views[k]).join(", ")],
    ...item.matches.map((m) => [`Match ${m.match}`, `${views[m.left_view]}, ${views[m.right_view]}`]),
  ];
  element.replaceChildren(
    make("h2", {}, swatch(item.color), `Polygon ${item.id}`, item.label ? make("span", { class: "label" }, item.label) : null),
    make("table", { class: "facts" }, rows.map(([name, value]) => make("tr", {}, make("th", { scope: "row" }, name), make("td", {}, String(value))))),
  );
}

function swatch(color) {
  const element = make("i", { class: "swatch" });
  element.style.background = color;
  return element;
}

function rgbOf(hex) {
  return [1, 3, 5].map((k) => Number.parseInt(hex.slice(k, k + 2), 16));
}

/** By a column; equal ones by id. */
function sortedBy(items, column, down) {
  const sign = down ? -1 : 1;
  const value = (item) => item[column] ?? "";
  return [...items].sort((a, b) => (value(a) === value(b) ? a.id - b.id : sign * (value(a) < value(b) ? -1 : 1)));
}

new CloudPage(JSON.parse(the("data").textContent)).start();
