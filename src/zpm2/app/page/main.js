// The page of zpm2 app: a person points at a region in one photograph and sees it in the other one.

import { make, shown, the } from "#report/dom.js";
import { offer } from "#report/downloads.js";
import { pointers } from "#report/pointers.js";
import { otherTheme, stepped } from "#report/shell.js";
import { Stage } from "#report/stage.js";
import { showList, showRegion } from "#app/aside.js";
import { Canvas } from "#app/canvas.js";
import { History } from "#app/history.js";
import { onKeys } from "#app/keys.js";
import { areaOf, boxOfParts, flat } from "#app/outline.js";
import { colorOf, decided, hasPrompt, isWhole, NO_PROMPT, openedRegion, withCarried, withDrawn, withSize } from "#app/regions.js";
import { Server, tokenOf } from "#app/server.js";
import { twoPhotographs } from "#app/start.js";
import { Tools } from "#app/tools.js";
import { expectedPlace } from "#report/items.js";

const SIDES = ["left", "right"];
const OFTEN = 400; // ms between two questions how far the server is
const LATER = 500; // ms after a change until the browser keeps it

class App extends Stage {
  constructor(server, state, pictures) {
    super();
    Object.assign(this, { server, pair: state.number, reasons: {}, items: [], hovered: null, cursor: null, asked: 0, asking: 0 });
    this.state = { mode: "side", link: true, color: "match", fill: 30, numbers: true };
    this.tool = "point";
    this.panels = state.photographs.map((side, k) => new Canvas(the(`panel-${SIDES[k]}`), side, pictures[k], null, [], `${SIDES[k]} photograph`));
    this.made = new WeakMap(); // region -> its item with polygons
    this.name = `zpm2 regions ${server.token} ${this.pair}`;
    this.history = new History(this.kept() ?? { regions: state.regions.map((each, k) => openedRegion(each, k + 1)), selected: "" });
    this.tools = new Tools(this);
    this.on = {
      verdict: (region, verdict) => this.judge(region, verdict),
      size: (side, step) => this.otherSize(side, step),
      label: (text) => this.selected && this.put({ ...this.selected, label: text }),
      again: () => this.again(),
      say,
      select: (key) => this.select(key),
    };
  }

  start(formats) {
    the("names").replaceChildren(...this.panels.flatMap(({ side }, k) => [k ? make("i", {}, "and") : null, make("span", {}, side.name)]).filter(Boolean));
    for (const name of formats.filter((each) => each !== "geojson")) the("formats").append(make("label", {}, make("input", { type: "checkbox", value: name }), name));
    pointers(this);
    onKeys(this);
    for (const panel of this.panels) {
      panel.element.addEventListener("contextmenu", (event) => {
        event.preventDefault();
        const box = panel.element.getBoundingClientRect();
        const point = panel.toPhoto([event.clientX - box.left, event.clientY - box.top]);
        this.tools.click(null, { side: this.panels.indexOf(panel), point }, false);
      });
    }
    for (const input of document.querySelectorAll('[name="tool"]')) input.addEventListener("change", () => this.use(input.value));
    const clicked = { undo: () => this.undo(), redo: () => this.redo(), new: () => this.select(""), fit: () => this.fit(), theme: () => this.turnTheme(), export: () => this.export() };
    for (const [id, action] of Object.entries(clicked)) the(id).addEventListener("click", action);
    the("help-button").addEventListener("click", () => the("help").showModal());
    the("link").addEventListener("change", ({ target }) => (this.state.link = target.checked));
    the("fill").addEventListener("input", ({ target }) => {
      this.state.fill = Number(target.value);
      this.refresh(true);
    });
    addEventListener("beforeunload", (event) => this.unsaved && event.preventDefault());
    new ResizeObserver(() => this.layout()).observe(the("stage"));
    this.show();
    this.layout();
    this.prepare();
  }

  get regions() {
    return this.history.now.regions;
  }

  get selected() {
    return this.regions.find((region) => region.key === this.history.now.selected) ?? null;
  }

  get chosen() {
    return this.selected && this.itemOf(this.selected);
  }

  nextNumber() {
    return 1 + Math.max(0, ...this.regions.map((region) => region.number));
  }

  /** Lets the server look at the photographs, and says how far it is. */
  async prepare() {
    const due = setInterval(async () => {
      const { stage, share } = await this.server.get("/api/progress").catch(() => ({ stage: "", share: 0 }));
      if (!this.items.length) the("counts").textContent = `looking at the photographs: ${stage} ${Math.round(100 * share)} %`;
    }, OFTEN);
    try {
      const { points, messages, seconds } = await this.server.post("/api/prepare", { number: this.pair });
      this.items = points.map(([a, b, c, d]) => ({ kind: "match", polygons: [{ center: [a, b], area: 1 }, { center: [c, d], area: 1 }] }));
      the("messages").replaceChildren(...messages.map((text) => make("li", {}, text)));
      the("notes").hidden = !messages.length;
      document.documentElement.dataset.prepared = String(seconds);
    } catch (error) {
      say(error.message);
    }
    clearInterval(due);
    this.show();
  }

  /** Another region, or the same region changed: a step that can be undone, and a question to the server. */
  change(region, side) {
    this.put({ ...region, waiting: null });
    this.ask(this.selected, side);
  }

  /** Puts a region in the place of that with its key, and selects it. */
  put(region) {
    const { regions } = this.history.now;
    const known = regions.some((each) => each.key === region.key);
    this.history.push({ selected: region.key, regions: known ? regions.map((each) => (each.key === region.key ? region : each)) : [...regions, region] });
    this.show();
  }

  /** Shows a region that is being dragged. */
  preview(region) {
    this.dragged = region;
    this.hold();
    this.refresh(true);
  }

  /** Asks for the outline on a side, where the segmenter draws it, and where it was drawn first for the other side's. */
  async ask(region, side) {
    const question = (this.asked += 1);
    const { key } = region;
    const amend = (change) => {
      this.history.amend((state) => ({ ...state, regions: state.regions.map((each) => (each.waiting === question ? change(each) : each)) }));
      this.show();
    };
    this.history.amend((state) => ({ ...state, regions: state.regions.map((each) => (each === region ? { ...each, waiting: question } : each)) }));
    this.show();
    const about = { number: this.pair, region: key, side: SIDES[side] };
    const start = performance.now();
    this.asking += 1;
    try {
      let parts = region.shapes[side];
      if (hasPrompt(region.prompts[side])) {
        const drawn = await this.server.post("/api/draw", { ...about, prompt: region.prompts[side] });
        ({ parts } = drawn);
        amend((each) => withDrawn(each, side, drawn));
      }
      if (side === region.side) {
        const carried = await this.server.post("/api/carry", { ...about, parts });
        amend((each) => withCarried(each, carried));
      }
      document.documentElement.dataset.answered = `${question} ${Math.round(performance.now() - start)}`;
      amend((each) => ({ ...each, waiting: null }));
      say("");
    } catch (error) {
      amend((each) => ({ ...each, waiting: null, failed: error.message }));
    } finally {
      this.asking -= 1;
    }
  }

  /** Carries the selected region again. */
  again() {
    const region = this.selected;
    if (!region) return;
    const other = 1 - region.side;
    const prompts = other ? [region.prompts[0], NO_PROMPT] : [NO_PROMPT, region.prompts[1]];
    this.change({ ...region, prompts, failed: null, verdict: "", changed: true }, region.side);
  }

  otherSize(side, step) {
    const region = this.selected;
    const answers = region?.sizes[side];
    const size = answers ? answers.size + step : -1;
    if (size >= 0 && size < answers.sizes) this.change(withSize(region, side, size), side);
  }

  judge(region, verdict) {
    if (!region || (verdict === "accepted" && (!isWhole(region) || region.waiting !== null))) return;
    const next = { ...region, verdict: region.verdict === verdict ? "" : verdict };
    this.put(next);
    if (next.verdict) this.select("");
  }

  /** Selects a region, which is no step that can be undone. */
  select(key) {
    this.history.now = { ...this.history.now, selected: key };
    this.tools.cancel();
    this.show();
  }

  step(by) {
    const next = stepped(this.regions, this.history.now.selected, by);
    if (next) this.select(next.key);
  }

  undo() {
    if (!this.tools.cancel() && this.history.undo()) this.show();
  }

  redo() {
    if (this.history.redo()) this.show();
  }

  turnTheme() {
    const { dataset } = document.documentElement;
    dataset.theme = otherTheme(dataset);
  }

  use(tool) {
    this.tool = tool;
    this.tools.cancel();
    this.show();
  }

  async export() {
    const regions = decided(this.regions);
    const formats = [...the("formats").querySelectorAll("input:checked")].map((input) => input.value);
    the("export-note").textContent = "Writing …";
    try {
      const archive = await this.server.blob("/api/export", { number: this.pair, regions, formats });
      offer("zpm2-app.zip", "application/zip", archive);
      this.exported = this.regions;
      the("export-note").textContent = `${shown(regions.filter((region) => region.accepted).length)} accepted regions are in zpm2-app.zip`;
    } catch (error) {
      the("export-note").textContent = error.message;
    }
  }

  get unsaved() {
    return this.exported !== this.regions && this.regions.some((region) => region.verdict);
  }

  /** What the browser kept of this pair before the page was loaded again. */
  kept() {
    try {
      const found = JSON.parse(sessionStorage.getItem(this.name));
      return found && { ...found, regions: found.regions.map((region) => ({ ...region, waiting: null, failed: region.waiting === null ? region.failed : "the page was loaded again before the answer came" })) };
    } catch {
      return null;
    }
  }

  keep() {
    clearTimeout(this.keeping);
    this.keeping = setTimeout(() => {
      try {
        sessionStorage.setItem(this.name, JSON.stringify(this.history.now));
      } catch {
        // it has no room for so many regions: they last as long as the page
      }
    }, LATER);
  }

  /** A region as the report's parts know it: with the polygons of both photographs. */
  itemOf(region) {
    if (this.made.has(region)) return this.made.get(region);
    const item = { key: region.key, id: region.number, kind: "match", color: colorOf(region), confidence: 0, stage: null, label: region.label, polygons: [null, null] };
    item.polygons = region.shapes.map((parts, side) => {
      if (!parts) return null;
      const box = boxOfParts(parts);
      const center = [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2];
      return { id: region.number, side, rings: flat(parts), box, center, area: areaOf(parts), shown: true, item };
    });
    this.made.set(region, item);
    return item;
  }

  /** Gives the panels the polygons of what is shown: rejected regions only while they are selected. */
  hold() {
    const shown = this.regions.filter((region) => region.verdict !== "rejected" || region.key === this.history.now.selected);
    const items = shown.map((region) => this.itemOf(region.key === this.dragged?.key ? this.dragged : region));
    this.panels.forEach((panel, side) => panel.hold(items.map((item) => item.polygons[side]).filter(Boolean)));
  }

  /** Shows the state. */
  show() {
    this.dragged = null;
    this.keep();
    this.hold();
    const { regions, selected } = this.history.now;
    const accepted = regions.filter((region) => region.verdict === "accepted").length;
    if (document.documentElement.dataset.prepared) the("counts").textContent = regions.length ? `${shown(regions.length)} ${regions.length === 1 ? "region" : "regions"}, ${shown(accepted)} accepted` : "";
    the("exports").hidden = false;
    the("export").disabled = !decided(regions).length;
    the("undo").disabled = !this.history.past.length;
    the("redo").disabled = !this.history.future.length;
    the("new").disabled = !selected;
    document.body.dataset.tool = this.tool;
    for (const input of document.querySelectorAll('[name="tool"]')) input.checked = input.value === this.tool;
    showRegion(the("detail"), this.selected, this);
    showList(the("regions"), regions, selected, this.on);
    this.refresh(true);
  }

  choose(item, { side, point, event }) {
    this.tools.click(item, { side, point }, !event.altKey);
  }

  grab(side, point, event) {
    return this.tools.grab(side, point, event);
  }

  zoomTo(item) {
    if (this.tools.close() || this.tool !== "edit" || !item) return;
    item.polygons.forEach((polygon, k) => polygon && this.panels[k].center(polygon.center, this.panels[k].zoomOf(polygon.box)));
    this.refresh();
  }

  hover(item, cursor = null) {
    this.hovered = this.tool === "edit" ? item : null;
    this.cursor = cursor;
    this.marks();
  }

  /** What moves with the cursor: where it is in the other photograph, and what the person is drawing. */
  marks() {
    const region = this.dragged ?? this.selected;
    const { sketch, box } = this.tools;
    this.panels.forEach((panel, side) => {
      if (!panel.width) return;
      const polygons = [...new Set([region && this.itemOf(region), this.hovered])]
        .filter((item) => item?.polygons[side])
        .map((item) => ({ polygon: item.polygons[side], color: item.color, strong: item === this.hovered }));
      const there = this.cursor && this.cursor.side !== side ? expectedPlace(this.items, this.cursor.side, this.cursor.point) : null;
      const drawn = sketch?.side === side ? [...sketch.ring, ...(this.cursor?.side === side ? [this.cursor.point] : [])] : null;
      panel.paintTop({
        polygons,
        line: null,
        spot: there && panel.holds(there.point) ? there.point : null,
        prompt: region?.prompts[side] ?? null,
        sketch: drawn,
        box: box?.side === side ? box.corners : null,
        vertices: this.tool === "edit" ? region?.shapes[side] : null,
      });
    });
  }
}

/** Shows a message over the page; an empty one takes it away. */
function say(text) {
  the("message").textContent = text;
  the("message").hidden = !text;
}

async function begin() {
  const server = new Server(tokenOf());
  try {
    let state = await server.get("/api/state");
    if (!state.photographs.every(Boolean)) state = await twoPhotographs(server, state, say);
    const pictures = await Promise.all(
      SIDES.map(async (side) => {
        const picture = new Image();
        picture.src = URL.createObjectURL(await server.blob(`/api/photograph/${side}`));
        await picture.decode();
        return picture;
      }),
    );
    the("work").hidden = false;
    window.app = new App(server, state, pictures);
    window.app.start(state.formats);
  } catch (error) {
    say(error.message);
  }
}

await begin();
