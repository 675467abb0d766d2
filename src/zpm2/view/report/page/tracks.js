// The report of tracks: photographs with all regions on the left, a strip of close-ups for each track on the right.

import { csvText, offer, unpacked } from "#report/downloads.js";
import { make, shown, the } from "#report/dom.js";
import { CONFIDENCE } from "#report/items.js";
import { Panel } from "#report/panel.js";
import { pointers } from "#report/pointers.js";
import { showFacts } from "#report/run.js";
import { connectKeys, connectReset, connectState, keepAddress, otherTheme, showAlert, showState, showTab, stepped } from "#report/shell.js";
import { TRACKS, fromFragment, toFragment } from "#report/state.js";
import { Strips } from "#report/strips.js";
import { ordered, passes, rowsOf, tracksOf } from "#report/trackitems.js";

const REST = 120; // ms without a move

class TracksReport {
  constructor(data) {
    this.data = data;
    this.names = data.photographs.map(({ name }) => name);
    Object.assign(this, tracksOf(data));
    this.byKey = new Map(this.items.map((item) => [item.key, item]));
    this.state = fromFragment(location.hash, TRACKS);
    this.hovered = null;
    this.panels = data.photographs.map((photograph, k) => {
      const element = make("div", { class: "panel" });
      the("photographs").append(make("figure", {}, element, make("figcaption", { title: photograph.path }, photograph.name)));
      element.style.aspectRatio = `${photograph.width} / ${photograph.height}`;
      return new Panel(element, photograph, the(`picture-${k}`), null, this.polygons[k], photograph.name);
    });
    this.strips = new Strips(the("strips"), this.panels, this.names, {
      select: (item) => this.choose(item),
      hover: (item) => this.hover(item),
      zoom: (item) => this.zoomTo(item),
    });
    this.near = new Set(); // panels in sight; the others are painted when they come into it
    this.watch = new IntersectionObserver((entries) => {
      for (const { isIntersecting, target } of entries) {
        const panel = this.panels.find(({ element }) => element === target);
        if (isIntersecting) this.near.add(panel);
        else this.near.delete(panel);
      }
      this.refresh(true);
    }, { root: the("stage"), rootMargin: "200px" });
    for (const { element } of this.panels) this.watch.observe(element);
  }

  start() {
    const pairs = this.data.run.pairs;
    the("counts").textContent = `${shown(pairs)} pair${pairs === 1 ? "" : "s"} of photographs matched (${this.data.run.chosen})`;
    showAlert(this.data.run, () => this.set({ tab: "run" }));
    const facts = [["zpm2", this.data.run.version], ["Pairs", `${pairs}: ${this.data.run.chosen}`], ...this.data.photographs.map(({ name, path, width, height }) => [name, `${path}, ${width} × ${height} px`])];
    showFacts(the("run"), facts, this.data.run, this.data.timings);
    this.connect();
    pointers(this, true);
    new ResizeObserver(() => this.layout()).observe(the("photographs"));
    addEventListener("hashchange", () => this.adopt(fromFragment(location.hash, TRACKS)));
    this.adopt(this.state);
  }

  connect() {
    const set = (changes) => this.set(changes);
    connectState(TRACKS, set);
    connectReset(TRACKS, ["photographs", "min", "max", "carried", "text"], set);
    for (const tab of ["list", "run"]) the(`tab-${tab}`).addEventListener("click", () => this.set({ tab }));
    the("theme").addEventListener("click", () => this.turnTheme());
    the("fit").addEventListener("click", () => this.fit());
    for (const button of document.querySelectorAll("[data-offer]")) button.addEventListener("click", () => this.give(button.dataset.offer));
    connectKeys({
      ArrowDown: () => this.step(1),
      ArrowUp: () => this.step(-1),
      j: () => this.step(1),
      k: () => this.step(-1),
      Enter: () => this.zoomTo(this.chosen),
      Escape: () => this.choose(null),
      0: () => this.fit(),
      c: () => this.set({ color: this.state.color === "match" ? "confidence" : "match" }),
      i: () => this.set({ numbers: !this.state.numbers }),
      d: () => this.turnTheme(),
      "/": () => {
        this.set({ tab: "list" });
        document.querySelector('[data-state="text"]').focus();
      },
    });
  }

  async give(what) {
    if (what === "table") offer("tracks.csv", "text/csv", csvText(rowsOf(this.listed, this.names)));
    else if (the("document").textContent) offer("tracks.json", "application/json", await unpacked(the("document").textContent, "{}"));
    else window.open("tracks.json"); // a large one lies beside the page
  }

  set(changes) {
    this.adopt({ ...this.state, ...changes });
    keepAddress(toFragment(this.state, TRACKS));
  }

  adopt(state) {
    const before = this.state;
    this.state = state;
    showState(state);
    showTab(["list", "run"], state.tab);
    if (state === before || Object.keys(state).some((name) => name !== "select" && state[name] !== before[name])) {
      for (const item of this.items) for (const polygon of item.seen) polygon.shown = passes(item, state, this.names);
      this.listed = ordered(this.items.filter((item) => passes(item, state, this.names)), state.sort);
      the("listed").textContent = `${shown(this.listed.length)} of ${shown(this.items.length)} tracks shown`;
      this.strips.show(this.listed, state);
      this.legend();
      the("photographs").style.setProperty("--across", state.across);
      this.layout();
    }
    this.strips.reveal(state.select);
    this.marks();
  }

  legend() {
    const entry = ([least, color]) => {
      const swatch = make("i", { class: "swatch" });
      swatch.style.background = color;
      return make("span", {}, swatch, least ? `from ${least}` : "less");
    };
    const { color } = this.state;
    the("legend").replaceChildren(...(color === "match" ? [make("span", {}, "same colour and number, same region")] : CONFIDENCE.map(entry)));
  }

  layout() {
    for (const panel of this.panels) panel.resize();
    this.refresh(true);
  }

  fit() {
    for (const panel of this.panels) panel.fit();
    this.refresh(true);
  }

  zoom(panel, place, factor) {
    panel.zoomAt(place, factor);
    this.follow();
  }

  follow() {
    this.refresh();
  }

  /** Zooms all photographs that show a track to it. */
  zoomTo(item) {
    for (const polygon of item?.seen ?? []) {
      const panel = this.panels[polygon.photograph];
      panel.center(polygon.center, panel.zoomOf(polygon.box));
    }
    this.refresh(true);
  }

  choose(item) {
    this.set({ select: item ? item.key : "" });
  }

  step(rows) {
    const next = stepped(this.listed, this.state.select, rows);
    if (next) this.choose(next);
  }

  turnTheme() {
    this.set({ theme: otherTheme(this.state) });
  }

  /** From a strip, or from a photograph (then with the cursor): there the strips move to the track. */
  hover(item, cursor = null) {
    if (item === this.hovered) return;
    this.hovered = item ?? null;
    if (item && cursor && !this.chosen) this.strips.reveal(item.key);
    this.marks();
  }

  get chosen() {
    return this.byKey.get(this.state.select) ?? null;
  }

  /** Paints again, once before the next frame. shapes: the polygons have changed; else the view may have moved. */
  refresh(shapes = false) {
    this.changed ||= shapes;
    this.due ??= requestAnimationFrame(() => {
      this.due = null;
      for (const panel of this.near) {
        if (!panel.width) continue;
        panel.paintPhoto();
        if (panel.view === panel.painted && !this.changed) continue;
        if (this.changed || !panel.moveShapes()) panel.paintShapes(this.state, {});
        else this.settle();
      }
      this.changed = false;
      this.marks();
      document.documentElement.dataset.ready ??= String(Math.round(performance.now()));
    });
  }

  settle() {
    clearTimeout(this.resting);
    this.resting = setTimeout(() => this.refresh(true), REST);
  }

  /** The outlines of the hovered and the chosen track, in all photographs and in the list. */
  marks() {
    for (const panel of this.near) {
      if (!panel.width) continue;
      const k = this.panels.indexOf(panel);
      const polygons = [];
      for (const item of new Set([this.chosen, this.hovered])) {
        const polygon = item?.polygons[k];
        if (polygon) polygons.push({ polygon, color: item.color, strong: item === this.hovered });
      }
      panel.paintTop({ polygons, line: null, spot: null });
    }
    const lit = this.hovered ?? this.chosen;
    this.panels.forEach(({ element }, k) => element.classList.toggle("without", Boolean(lit) && !lit.polygons[k]));
    this.strips.mark(this.hovered?.key, this.state.select);
  }
}

const data = JSON.parse(the("data").textContent);
const report = new TracksReport({ ...data, timings: JSON.parse(the("timings").textContent) });
await Promise.all([...document.querySelectorAll("img.source")].map((picture) => picture.decode()));
report.start();
