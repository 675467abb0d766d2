// The report of a pair: puts state, photographs, table and details together.

import { connectControls, listChoices, showLegend } from "#report/controls.js";
import { WAYS, comparison } from "#report/comparison.js";
import { shown, the } from "#report/dom.js";
import { showDetail } from "#report/detail.js";
import { clipLine, multiply, transposed } from "#report/geometry.js";
import { itemsOf, paintOf, passes, sorted } from "#report/items.js";
import { onKeys } from "#report/keys.js";
import { Panel } from "#report/panel.js";
import { pointers } from "#report/pointers.js";
import { showRun } from "#report/run.js";
import { keepAddress, otherTheme, showAlert, showState, showTab, stepped } from "#report/shell.js";
import { Stage } from "#report/stage.js";
import { fromFragment, toFragment } from "#report/state.js";
import { PAIR_COLUMNS, Table, filled } from "#report/table.js";
import { Tiles } from "#report/tiles.js";
import { Verdicts } from "#report/verdicts.js";

const SMALL = 40; // screen px; a link to a smaller polygon zooms to it
const BLINK = 800; // ms that each photograph is shown

class Report extends Stage {
  constructor(data) {
    super();
    this.data = data;
    this.reasons = data.reasons;
    data.sides.forEach((side, k) => (side.tiles = data.tiles[k]));
    Object.assign(this, itemsOf(data));
    this.byKey = new Map(this.items.map((item) => [item.key, item]));
    this.state = fromFragment(location.hash);
    this.pictures = Object.fromEntries([...document.querySelectorAll("img.source")].map((img) => [img.id.slice(8), img]));
    this.panels = data.sides.map((side, k) => {
      const tiles = side.tiles && new Tiles(side, this.pictures[side.name], () => this.arrived());
      return new Panel(the(`panel-${side.name}`), side, this.pictures[side.name], tiles, this.polygons[k], `${side.name} photograph`);
    });
    this.saved = new Verdicts(data);
    this.verdicts = this.saved.of;
    this.hovered = null;
    this.cursor = null; // {side, point} of the photograph
    this.playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.on = { verdict: (item, verdict) => this.judge(item, verdict), select: (key) => this.set({ select: key }) };
    this.table = new Table(the("table-head"), the("table-body"), filled(PAIR_COLUMNS, this.items), {
      sort: (column) => this.set({ sort: column, down: this.state.sort === column && !this.state.down }),
      select: (item) => this.choose(item),
      hover: (item) => this.hover(item),
      color: (item) => paintOf(item, this.state.color, this.reasons).color,
    });
  }

  start() {
    const count = this.data.matches.length;
    const [left, right] = this.data.sides.map((side) => shown(side.polygons.length));
    the("counts").textContent = `${shown(count)} ${count === 1 ? "match" : "matches"} of ${left} left and ${right} right polygons`;
    showAlert(this.data.run, () => this.set({ tab: "run" }));
    showRun(the("run"), this.data);
    listChoices(this);
    connectControls(this);
    pointers(this);
    onKeys(this);
    new ResizeObserver(() => this.layout()).observe(the("stage"));
    addEventListener("hashchange", () => this.adopt(fromFragment(location.hash)));
    setInterval(() => this.playing && this.state.mode === "blink" && this.blink(), BLINK);
    this.adopt(this.state);
    const small = this.chosen?.polygons.some((p, k) => p && Math.max(p.box[2] - p.box[0], p.box[3] - p.box[1]) * this.panels[k].view.zoom < SMALL);
    if (small) this.zoomTo(this.chosen);
  }

  /** Changes members of the state, and the address with it. */
  set(changes) {
    this.adopt({ ...this.state, ...changes });
    keepAddress(toFragment(this.state));
  }

  /** Shows a state. */
  adopt(state) {
    const before = this.state;
    this.state = state;
    if (state !== before && Object.keys(state).every((name) => name === "select" || state[name] === before[name])) {
      this.table.reveal(state.select); // nothing else to do for another choice, which keeps thousands of rows quick
      this.detail();
      this.marks();
      return;
    }
    showState(state);
    showTab(["list", "run"], state.tab);
    document.body.dataset.mode = state.mode;
    for (const box of the("chosen").querySelectorAll("input")) box.checked = !state.hide.includes(box.value);
    for (const item of this.items) {
      item.verdict = this.verdicts[item.key];
      const through = passes(item, state);
      for (const polygon of item.polygons) if (polygon) polygon.shown = through;
    }
    this.listed = sorted(this.items.filter((item) => passes(item, state)), state.sort, state.down);
    const judged = Object.keys(this.verdicts).length;
    the("listed").textContent = `${shown(this.listed.length)} of ${shown(this.items.length)} shown${judged ? `, ${judged} judged` : ""}`;
    this.table.show(this.listed, state);
    if (state.select !== before.select || before === state) this.table.reveal(state.select);
    showLegend(this);
    this.compare();
    this.layout();
    this.detail();
  }

  /** Lays the aligned right photograph over the left one, or takes it away. */
  compare() {
    const { mode } = this.state;
    const align = this.align;
    const [left] = this.panels;
    const failed = mode === "side" ? null : this.data.aligned[align];
    const was = left.over;
    left.over = mode === "side" || failed ? null : this.pictures[align];
    if (left.over && (!was || this.was !== mode)) left.edge = mode === "curtain" ? 0.5 : 1;
    this.was = mode;
    the("no-compare").hidden = !failed;
    the("no-compare").textContent = failed ? `The photographs cannot be laid over each other by ${WAYS[align]}: ${failed}` : "";
    the("compared").hidden = mode === "side" || Boolean(failed);
    the("compared").textContent = comparison(align, this.data);
    document.querySelector('[data-state="align"]').value = align;
    the("play").textContent = this.playing ? "Pause" : "Play";
  }

  /** What curtain and blink are aligned by. */
  get align() {
    return this.state.align || (["points", "epipolar", "homography"].find((how) => !this.data.aligned[how]) ?? "points");
  }

  blink() {
    this.panels[0].edge = this.panels[0].edge > 0.5 ? 0 : 1;
    this.refresh();
  }

  play(playing) {
    this.playing = playing;
    this.compare();
  }

  zoomTo(item) {
    if (!item) return;
    const [left, right] = item.polygons;
    const [first, second] = this.panels;
    if (item.kind === "match" && this.state.mode === "side") {
      const factor = Math.sqrt(right.area / left.area);
      const zoom = Math.min(first.zoomOf(left.box), second.zoomOf(right.box) * factor);
      first.center(left.center, zoom);
      second.center(right.center, zoom / factor);
    } else if (left) {
      first.center(left.center, first.zoomOf(left.box));
      this.follow(first);
    } else if (this.state.mode === "side") {
      second.center(right.center, second.zoomOf(right.box));
      this.follow(second);
    }
    this.refresh();
  }

  choose(item) {
    this.set({ select: item ? item.key : "" });
    if (!item || this.state.mode !== "side") return;
    item.polygons.forEach((polygon, k) => {
      if (polygon && !this.panels[k].whole) this.panels[k].center(polygon.center);
    });
    this.refresh();
  }

  /** Moves the choice by rows of the table. */
  step(rows) {
    const next = stepped(this.listed, this.state.select, rows);
    if (!next) return;
    this.choose(next);
    this.table.reveal(next.key);
  }

  judge(item, verdict) {
    if (item?.kind !== "match") return;
    this.saved.set(item.key, this.verdicts[item.key] === verdict ? null : verdict);
    this.adopt(this.state);
  }

  turnTheme() {
    this.set({ theme: otherTheme(this.state) });
  }

  hover(item, cursor = null) {
    const same = item === this.hovered;
    this.hovered = item;
    this.cursor = cursor;
    if (!same) this.detail();
    this.marks();
  }

  get chosen() {
    return this.byKey.get(this.state.select) ?? null;
  }

  detail() {
    showDetail(the("detail"), this.hovered ?? this.chosen, this);
    this.table.mark(this.hovered?.key, this.state.select);
  }

  /** A tile has come, or there are none. */
  arrived() {
    const missing = this.panels.some((panel) => panel.tiles?.missing);
    document.documentElement.dataset.tiles = missing ? "missing" : "shown";
    the("no-tiles").hidden = !missing;
    if (missing) the("no-tiles").textContent = `Reduced photographs: ${this.data.sides[0].tiles?.folder ?? this.data.sides[1].tiles.folder}/ is not beside this page.`;
    this.refresh();
    this.detail();
  }

  /** What moves with the cursor: outlines of the hovered and the chosen item, epipolar line. */
  marks() {
    const matrix = this.data.fundamental.matrix;
    this.panels.forEach((panel, k) => {
      if (!panel.width || panel.element.hidden) return;
      const polygons = [];
      for (const item of [this.chosen, this.hovered]) {
        const polygon = item?.polygons[k];
        if (polygon) polygons.push({ polygon, color: paintOf(item, this.state.color, this.reasons).color, strong: item === this.hovered });
      }
      let line = null;
      if (this.cursor && this.cursor.side !== k && this.state.line && matrix) {
        const [x, y] = this.cursor.point;
        line = clipLine(multiply(k ? matrix : transposed(matrix), [x, y, 1]), [0, 0, panel.side.width, panel.side.height]);
      }
      panel.paintTop({ polygons, line, spot: this.cursor?.side === k && this.state.line && matrix ? this.cursor.point : null });
    });
  }
}

const data = JSON.parse(the("data").textContent);
const report = new Report({ ...data, timings: JSON.parse(the("timings").textContent) });
await Promise.all(Object.values(report.pictures).map((picture) => picture.decode()));
report.start();
