// The modules of zpm2 app that need no browser.

import assert from "node:assert/strict";
import test from "node:test";

const load = (name) => import(`#app/${name}.js`);
const [history, outline, regions] = await Promise.all(["history", "outline", "regions"].map(load));
const SQUARE = [[[[0, 0], [10, 0], [10, 10], [0, 10]], [[4, 4], [4, 6], [6, 6], [6, 4]]]];

test("undo and redo", () => {
  const steps = new history.History(1);
  assert.equal(steps.undo(), false);
  steps.push(2);
  steps.push(3);
  assert.equal(steps.undo(), true);
  assert.equal(steps.now, 2);
  steps.amend((value) => value * 10); // an answer reaches what was undone, too
  assert.equal(steps.redo(), true);
  assert.equal(steps.now, 30);
  steps.undo();
  steps.push(4);
  assert.equal(steps.redo(), false);
  assert.deepEqual([steps.past, steps.now], [[10, 20], 4]);
});

test("vertices", () => {
  assert.equal(outline.areaOf(SQUARE), 96);
  assert.deepEqual(outline.boxOfParts(SQUARE), [0, 0, 10, 10]);
  assert.deepEqual(outline.flat(SQUARE).map((ring) => ring.length), [8, 8]);
  assert.deepEqual(outline.vertexNear(SQUARE, [9.5, 0.2], 1), [0, 0, 1]);
  assert.deepEqual(outline.vertexNear(SQUARE, [6.1, 5.9], 1), [0, 1, 2]);
  assert.equal(outline.vertexNear(SQUARE, [2, 2], 1), null);
  assert.deepEqual(outline.edgeNear(SQUARE, [5, 0.3], 1), [0, 0, 1]);
  assert.deepEqual(outline.edgeNear(SQUARE, [0.3, 5], 1), [0, 0, 4]); // the edge that closes the ring
  assert.equal(outline.edgeNear(SQUARE, [2, 2], 1), null);
});

test("an edited outline is a new one", () => {
  const before = structuredClone(SQUARE);
  assert.deepEqual(outline.moved(SQUARE, [0, 0, 1], [12, 1])[0][0][1], [12, 1]);
  assert.deepEqual(outline.inserted(SQUARE, [0, 0, 4], [0, 5])[0][0].at(-1), [0, 5]);
  const triangle = outline.removed(SQUARE, [0, 0, 1]);
  assert.equal(triangle[0][0].length, 3);
  assert.deepEqual(outline.removed(triangle, [0, 0, 1]), triangle);
  assert.deepEqual(SQUARE, before);
});

test("drawing anew where a region began asks for the other side again; a correction there stays", () => {
  const { withPoint, withDrawn, withCarried, withBox, withOutline, regionOf, hasPrompt, isWhole } = regions;
  let region = withPoint(regionOf(1, 1), 1, [5, 6], true);
  assert.ok(hasPrompt(region.prompts[1]));
  region = withDrawn(region, 1, { parts: SQUARE, size: 1, sizes: 3, score: 0.9 });
  assert.ok(!isWhole(region));
  region = withCarried(region, { parts: SQUARE, status: "found", reason: "", confidence: 0.8, agreement: 0.7, visible: 1, points: 9 });
  assert.ok(isWhole(region));
  const corrected = withBox({ ...region, verdict: "accepted" }, 0, [9, 9], [1, 2]);
  assert.deepEqual(corrected.prompts[0].box, [1, 2, 9, 9]);
  assert.deepEqual([corrected.outcome.status, corrected.outcome.agreement, corrected.verdict], ["corrected", 0.7, ""]);
  const again = withPoint(corrected, 1, [7, 7], false);
  assert.deepEqual(again.prompts[1].points, [[5, 6, 1], [7, 7, 0]]);
  assert.ok(!hasPrompt(again.prompts[0]));
  const own = withOutline(region, 1, SQUARE);
  assert.ok(!hasPrompt(own.prompts[1]));
  assert.equal(own.sizes[1], null);
});

test("only what a person decided is exported", () => {
  const whole = { shapes: [SQUARE, SQUARE], outcome: { agreement: 0.5, visible: null, points: 3 } };
  const opened = (match) => regions.openedRegion({ match, label: null, left: SQUARE, right: SQUARE, confidence: 0.4 }, match + 1);
  const found = regions.decided([
    { ...regions.regionOf(1, 0), ...whole, verdict: "accepted", label: "a <b>" },
    { ...regions.regionOf(2, 0), ...whole },
    { ...regions.regionOf(3, 0), ...whole, verdict: "rejected" },
    { ...regions.regionOf(4, 0), shapes: [SQUARE, null], verdict: "accepted" },
    opened(7),
    { ...opened(8), verdict: "accepted" },
    { ...opened(9), verdict: "rejected" },
  ]);
  assert.deepEqual(found.map((each) => [each.match, each.accepted, each.left === null]), [[null, true, false], [8, true, true], [9, false, true]]);
  assert.deepEqual([found[0].label, found[0].agreement, found[0].points], ["a <b>", 0.5, 3]);
});

test("all modules are valid, and find what they import", async () => {
  for (const name of ["aside", "keys", "start", "tools", "server"]) await load(name);
  globalThis.Path2D = class {};
  await load("canvas");
});
