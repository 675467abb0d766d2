// The page's modules that need no browser: `node --test`, started by test_report_modules.py.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readdirSync } from "node:fs";
import { test } from "node:test";
import { gzipSync } from "node:zlib";
import { pathToFileURL } from "node:url";

const load = (name) => import(pathToFileURL(`${process.env.PAGE}/${name}.js`).href);
const geometry = await load("geometry");
const items = await load("items");
const state = await load("state");
const downloads = await load("downloads");

const square = (x, y, size) => [x, y, size, 0, 0, size, -size, 0]; // from vertex to vertex
const polygon = (id, ring, more = {}) => ({ id, area: 16, score: 1, label: null, parent: null, why: null, rings: [ring], ...more });
const match = (id, right, more = {}) =>
  ({ id, left: id, right, confidence: 0.9, cost: 1, dsf: 3, stage: "global", overlap: 0.8, visible: 1, color: "#ff0000", ...more });
const DATA = {
  steps: 2,
  scales: [[0.5, 0.5], [1, 1]],
  sides: [
    { name: "left", path: "a.png", width: 100, height: 50, polygons: [polygon(1, square(2, 2, 4), { label: 'say "a",b' }), polygon(4, square(20, 2, 4)), polygon(7, square(8, 8, 2), { why: "occluded", area: 4 })] },
    { name: "right", path: "b.png", width: 100, height: 50, polygons: [polygon(0, square(40, 4, 8)), polygon(2, square(80, 4, 8)), polygon(5, square(2, 2, 2), { why: "no candidate", label: "Car" })] },
  ],
  matches: [match(1, 0), match(4, 2, { confidence: 0.4, stage: "guided", cost: 2 })],
};

test("rings are decoded to px of the photograph", () => {
  assert.deepEqual([...items.decodeRing([2, 4, 4, 0, 0, 6], 2, [0.5, 1])], [2, 2, 6, 2, 6, 5]);
});

test("a point is inside of a ring but not of its hole", () => {
  const rings = [[0, 0, 10, 0, 10, 10, 0, 10], [4, 4, 6, 4, 6, 6, 4, 6]];
  assert.ok(geometry.inside(rings, 2, 2));
  assert.ok(!geometry.inside(rings, 5, 5));
  assert.ok(!geometry.inside(rings, 11, 5));
});

test("the grid names every box that holds a point", () => {
  const boxes = Array.from({ length: 300 }, (_, k) => [(k * 37) % 90, (k * 53) % 40, ((k * 37) % 90) + 3 + (k % 9), ((k * 53) % 40) + 2 + (k % 7)]);
  const grid = new geometry.Grid(boxes, 100, 50);
  for (let k = 0; k < 500; k++) {
    const [x, y] = [(k * 7.3) % 100, (k * 3.1) % 50];
    const near = new Set(grid.near(x, y));
    boxes.forEach(([x0, y0, x1, y1], n) => x >= x0 && x <= x1 && y >= y0 && y <= y1 && assert.ok(near.has(n)));
    assert.ok(near.size < 120);
  }
});

test("a line is cut to a box", () => {
  assert.deepEqual(geometry.clipLine([0, 1, -5], [0, 0, 10, 10]), [[0, 5], [10, 5]]);
  assert.deepEqual(geometry.clipLine([1, 0, -5], [0, 0, 10, 10]), [[5, 0], [5, 10]]);
  assert.deepEqual(geometry.clipLine([1, -1, 0], [0, 0, 10, 10]), [[0, 0], [10, 10]]);
  assert.equal(geometry.clipLine([0, 1, 5], [0, 0, 10, 10]), null);
});

test("epipolar lines", () => {
  const sideways = [[0, 0, 0], [0, 0, -1], [0, 1, 0]]; // rows stay rows
  assert.deepEqual(geometry.multiply(sideways, [3, 4, 1]), [0, -1, 4]);
  assert.deepEqual(geometry.transposed([[1, 2, 3], [4, 5, 6], [7, 8, 9]])[0], [1, 4, 7]);
});

test("items are the matches and all polygons without a partner", () => {
  const found = items.itemsOf(DATA);
  assert.deepEqual(found.items.map((item) => item.key), ["m1", "m4", "l7", "r5"]);
  assert.equal(found.items[2].why, "occluded");
  assert.equal(found.polygons[1][2].item.key, "r5");
  assert.deepEqual(found.polygons[0][0].box, [2, 2, 6, 6]);
});

test("filters", () => {
  const { items: all } = items.itemsOf(DATA);
  const kept = (changes) => all.filter((item) => items.passes(item, { ...state.DEFAULTS, ...changes })).map((item) => item.key);
  assert.deepEqual(kept({}), ["m1", "m4", "l7", "r5"]);
  assert.deepEqual(kept({ show: "matched" }), ["m1", "m4"]);
  assert.deepEqual(kept({ show: "unmatched" }), ["l7", "r5"]);
  assert.deepEqual(kept({ show: "right" }), ["r5"]);
  assert.deepEqual(kept({ hide: ["guided", "occluded"] }), ["m1", "r5"]);
  assert.deepEqual(kept({ min: 0.5 }), ["m1", "l7", "r5"]);
  assert.deepEqual(kept({ show: "matched", max: 0.5 }), ["m4"]);
  assert.deepEqual(kept({ least: 10 }), ["m1", "m4", "r5"]);
  assert.deepEqual(kept({ most: 10 }), ["l7"]);
  assert.deepEqual(kept({ text: "CAR" }), ["r5"]);
  assert.deepEqual(kept({ text: "2" }), ["m4"]);
});

test("sorting puts what has no value last, either way", () => {
  const { items: all } = items.itemsOf(DATA);
  const order = (column, down) => items.sorted(all, column, down).map((item) => item.key);
  assert.deepEqual(order("confidence", false), ["m4", "m1", "l7", "r5"]);
  assert.deepEqual(order("confidence", true), ["m1", "m4", "l7", "r5"]);
  assert.deepEqual(order("area", false), ["l7", "m1", "m4", "r5"]);
  assert.deepEqual(order("stage", false), ["m1", "m4", "r5", "l7"]);
  assert.deepEqual(order("id", true), ["m4", "m1", "l7", "r5"]);
});

test("a place is expected where the nearest matches lead", () => {
  const { items: all } = items.itemsOf(DATA);
  const { point, factor } = items.expectedPlace(all, 0, [4, 4]);
  assert.equal(factor, 1);
  assert.ok(Math.hypot(point[0] - 22, point[1] - 4) < 0.5);
  assert.equal(items.expectedPlace([], 0, [4, 4]), null);
});

test("confidence has a colour for each range", () => {
  assert.equal(new Set([0.2, 0.6, 0.8, 0.95].map(items.confidenceColor)).size, 4);
  assert.equal(items.confidenceColor(0.9), items.confidenceColor(1));
});

test("a state and its fragment", () => {
  const some = { ...state.DEFAULTS, select: "m4", mode: "curtain", hide: ["local", "no candidate"], min: 0.25, text: "a&b=<c>#", down: true, numbers: false };
  assert.deepEqual(state.fromFragment(`#${state.toFragment(some)}`), some);
  assert.equal(state.toFragment(state.DEFAULTS), "");
  assert.deepEqual(state.fromFragment("#mode=wrong&min=x&__proto__=1&nothing=2&constructor=3"), state.DEFAULTS);
});

test("a table as CSV", () => {
  const { items: all } = items.itemsOf(DATA);
  const rows = downloads.csv(all, { m1: "right" }).split("\r\n");
  assert.equal(rows.length, 6);
  assert.equal(rows[0].split(",").length, 16);
  assert.equal(rows[1], 'match,1,1,0,"say ""a"",b",,16,16,0.9,1,3,global,0.8,1,,right');
  assert.equal(rows[3], "left,7,7,,,,4,,,,,,,,occluded,");
});

test("verdicts come back", () => {
  const { items: all } = items.itemsOf(DATA);
  const text = JSON.stringify(downloads.verdictsDocument(DATA, all, { m1: "right", m4: "wrong" }));
  assert.deepEqual(downloads.readVerdicts(text, all), { m1: "right", m4: "wrong" });
  assert.deepEqual(downloads.readVerdicts(text, all.slice(1)), { m4: "wrong" });
  assert.throws(() => downloads.readVerdicts('{"schema": "other"}', all), /zpm2-verdicts/);
});

test("a packed document is unpacked", async () => {
  const url = `data:application/gzip;base64,${gzipSync('{"a": "ζ", "timings": {}}').toString("base64")}`;
  assert.equal(await downloads.unpacked(url, '{"read": 1.0}'), '{"a": "ζ", "timings": {"read": 1.0}}');
});

test("every module is valid and finds what it imports", async () => {
  const names = readdirSync(process.env.PAGE).filter((name) => name.endsWith(".js"));
  const pages = ["cloud.js", "main.js", "pairs.js", "tracks.js"]; // they start a page
  for (const name of pages) execFileSync(process.execPath, ["--check", `${process.env.PAGE}/${name}`]);
  for (const name of names) if (!pages.includes(name)) await load(name.slice(0, -3));
});

test("tracks: filters, order and table", async () => {
  const { ordered, passes, rowsOf, tracksOf } = await load("trackitems");
  const names = ["one.png", "two.png", "three.png"];
  const seen = (photograph, confidence, carried = false) => ({ photograph, confidence, carried, area: 16, rings: [square(2, 2, 4)] });
  const track = (id, where, absent = []) => ({ id, color: "#fff", closed: 0, absent, seen: where });
  const { items: all, polygons } = tracksOf({
    steps: 2,
    photographs: names.map((name) => ({ name, scale: [0.5, 1] })),
    tracks: [track(1, [seen(0, 0.9), seen(1, 0.6)], [[2, "hidden"]]), track(2, [seen(0, 1), seen(1, 0.9), seen(2, 0.8, true)]), track(12, [seen(1, 0.7), seen(2, 1)])],
  });
  assert.deepEqual(polygons.map((of) => of.map(({ id }) => id)), [[1, 2], [1, 2, 12], [2, 12]]);
  assert.deepEqual(all[0].polygons.map((polygon) => polygon?.box ?? null), [[2, 1, 6, 3], [2, 1, 6, 3], null]);
  const usual = state.TRACKS;
  const those = (changes) => all.filter((item) => passes(item, { ...usual, ...changes }, names)).map(({ id }) => id);
  assert.deepEqual(those({}), [1, 2, 12]);
  assert.deepEqual(those({ photographs: 3 }), [2]);
  assert.deepEqual(those({ min: 0.7, max: 0.75 }), [12]);
  assert.deepEqual(those({ carried: true }), [2]);
  assert.deepEqual(those({ text: "2" }), [2]);
  assert.deepEqual(those({ text: "THREE" }), [2, 12]);
  const order = (sort) => ordered(all, sort).map(({ id }) => id);
  assert.deepEqual([order("length"), order("weakest"), order("id"), order("area")], [[2, 1, 12], [1, 12, 2], [1, 2, 12], [1, 2, 12]]);
  const [, first, second] = downloads.csvText(rowsOf(all, names)).split("\r\n");
  assert.equal(first, "1,2,0.6,0,0,one.png two.png,three.png: hidden");
  assert.equal(second, "2,3,0.8,1,0,one.png two.png three.png,");
  const some = { ...usual, select: "t2", across: 4, sort: "weakest" };
  assert.deepEqual(state.fromFragment(`#${state.toFragment(some, usual)}`, usual), some);
});

test("the eye of a cloud turns around its target and moves with the pointer", async () => {
  const { moved, nearer, seenFrom, spun, times } = await load("orbit");
  const frame = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]; // z up, seen from -y
  const eye = { yaw: 0.7, pitch: -0.3, distance: 2, target: [0.3, -0.2, 0.4] };
  const at = ([matrix], point) => {
    const p = [0, 1, 2, 3].map((row) => point.reduce((sum, value, k) => sum + matrix[row + 4 * k] * value, matrix[row + 12]));
    return [p[0] / p[3], p[1] / p[3], p[2] / p[3]];
  };
  const near = (a, b) => assert.ok(Math.abs(a - b) < 1e-5, `${a} ${b}`);
  for (const each of [eye, spun(eye, 1, 0.2), nearer(eye, 3)]) at(seenFrom(frame, each, 0.7, 1.5), eye.target).slice(0, 2).forEach((value) => near(value, 0));
  const plain = seenFrom(frame, { yaw: 0, pitch: 0, distance: 2, target: [0, 0, 0] }, 0.7, 1.5);
  assert.ok(at(plain, [0.1, 0, 0])[0] > 0 && at(plain, [0, 0, 0.1])[1] > 0);
  assert.ok(at(plain, [0, -0.5, 0])[2] < at(plain, [0, 0.5, 0])[2]); // nearer to the views
  assert.ok(at(seenFrom(frame, { ...eye, yaw: 0, target: [0, 0, 0] }, 0.7, 1.5), [0, -0.5, 0])[1] < 0); // from above
  const half = Math.tan(0.35) * 2;
  const [x, y] = at(seenFrom(frame, moved(frame, eye, half, half / 2), 0.7, 1), eye.target);
  near(x, 1);
  near(y, 0.5);
  assert.equal(spun(eye, 0, 9).pitch, 1.57);
  assert.equal(nearer(eye, 1e9).distance, 0.02);
  assert.deepEqual([...times([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1], [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 4, 5, 6, 1])].slice(12), [5, 7, 9, 1]);
});

test("places of the polygons of a cloud", async () => {
  const { placesOf } = await load("scene");
  const packed = (values) => Buffer.from(Float32Array.from(values).buffer).toString("base64");
  const part = { vertices: packed([0, 0, 0, 2, 0, 0, 9, 9, 9, 1, 4, 0]), ids: packed([1, 1, -1, 1]) };
  assert.deepEqual(placesOf(part, 2), [null, { center: [1, 2, 0], size: Math.hypot(2, 4, 0) }]);
});

test("rows of pairs: sorted, those without a value last", async () => {
  const { ordered } = await load("rows");
  const rows = [["b/2", 0.5], ["a/10", null], ["c", 0.9]].map(([name, F1]) => ({ name, values: { F1 } }));
  const names = (state) => ordered(rows, { sort: "", down: false, text: "", ...state }).map((row) => row.name);
  assert.deepEqual(names({}), ["b/2", "a/10", "c"]);
  assert.deepEqual(names({ sort: "F1" }), ["b/2", "c", "a/10"]);
  assert.deepEqual(names({ sort: "F1", down: true }), ["c", "b/2", "a/10"]);
  assert.deepEqual(names({ sort: "name" }), ["a/10", "b/2", "c"]);
  assert.deepEqual(names({ text: " A/ " }), ["a/10"]);
});

test("verdicts are kept for one result", async () => {
  const { nameOf } = await load("verdicts");
  assert.equal(nameOf(DATA), nameOf(structuredClone(DATA)));
  const other = structuredClone(DATA);
  other.matches[0].right = 2;
  assert.notEqual(nameOf(DATA), nameOf(other));
  other.matches[0].right = 0;
  other.sides[0].polygons[0].area = 17;
  assert.notEqual(nameOf(DATA), nameOf(other));
});

test("keys step through the rows, and stop at both ends", async () => {
  const { stepped } = await load("shell");
  const rows = ["a", "b", "c"].map((key) => ({ key }));
  const from = (key, by) => stepped(rows, key, by).key;
  assert.deepEqual([from("", 1), from("", -1), from("a", 1), from("c", 1), from("a", -1), from("a", 9)], ["a", "c", "b", "c", "a", "c"]);
  assert.equal(stepped([], "a", 1), null);
});
