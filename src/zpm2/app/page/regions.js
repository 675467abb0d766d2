// Regions, and what a person does with them. A region is never changed in place.
//
// A region is drawn in one photograph, `side`, and carried to the other one. Each side has a prompt (points and a box
// for the segmenter) or an outline of the person's own, and a shape, which is null until it is known.

const COLORS = ["#ffd23f", "#3bceac", "#ee6c9c", "#6bb3f5", "#f58549", "#b79ced", "#9bc53d", "#e4572e"];
export const NO_PROMPT = Object.freeze({ points: [], box: null, size: null });

/** A new region, drawn in one photograph; `number` is what the person sees. */
export function regionOf(number, side) {
  return {
    key: `r${number}`,
    number,
    match: null, // of the opened result
    label: "",
    side,
    shapes: [null, null],
    prompts: [NO_PROMPT, NO_PROMPT],
    sizes: [null, null], // {size, sizes, score} of the segmenter's answers
    outcome: null, // of carrying it
    verdict: "", // accepted, rejected; empty: none yet
    changed: true, // not as in the opened result
    waiting: null, // number of the question that is asked about it
    failed: null, // why the last question has no answer
  };
}

/** A region of an opened result: {match, label, left, right, confidence}. */
export function openedRegion({ match, label, left, right, confidence }, number) {
  const outcome = { status: "matched", reason: `match ${match} of the opened result`, confidence, agreement: 0, visible: null, points: 0 };
  return { ...regionOf(number, 0), match, label: label ?? "", shapes: [left, right], outcome, changed: false };
}

export function colorOf(region) {
  return COLORS[(region.number - 1) % COLORS.length];
}

/** Whether the segmenter has something to go by on a side. */
export function hasPrompt({ points, box }) {
  return box !== null || points.some(([, , inside]) => inside);
}

export function withPoint(region, side, [x, y], inside) {
  const prompt = region.prompts[side];
  return prompted(region, side, { ...prompt, points: [...prompt.points, [x, y, inside ? 1 : 0]], size: null });
}

/** A box takes the place of what was drawn on that side before. */
export function withBox(region, side, [x0, y0], [x1, y1]) {
  const box = [Math.min(x0, x1), Math.min(y0, y1), Math.max(x0, x1), Math.max(y0, y1)];
  return prompted(region, side, { ...NO_PROMPT, box });
}

/** One of several answers to the prompt, the smallest first. */
export function withSize(region, side, size) {
  return prompted(region, side, { ...region.prompts[side], size });
}

/** An outline of the person's own. */
export function withOutline(region, side, parts) {
  const shapes = put(region.shapes, side, parts);
  return touched({ ...region, shapes, prompts: put(region.prompts, side, NO_PROMPT), sizes: put(region.sizes, side, null) }, side);
}

function prompted(region, side, prompt) {
  return touched({ ...region, prompts: put(region.prompts, side, prompt) }, side);
}

/** The other side of what was drawn anew is not known any more; one that a person corrected is the person's. */
function touched(region, side) {
  const next = { ...region, verdict: "", changed: true, failed: null };
  if (side !== region.side) return { ...next, outcome: corrected(region.outcome) };
  const other = 1 - side;
  return { ...next, prompts: put(next.prompts, other, NO_PROMPT), sizes: put(next.sizes, other, null) };
}

function corrected(outcome) {
  const { agreement = 0, points = 0, place = null } = outcome ?? {};
  return { status: "corrected", reason: "you drew it here yourself", confidence: null, agreement, visible: null, points, place };
}

export function withDrawn(region, side, { parts, size, sizes, score }) {
  return { ...region, shapes: put(region.shapes, side, parts), sizes: put(region.sizes, side, { size, sizes, score }) };
}

export function withCarried(region, { parts, ...outcome }) {
  return { ...region, shapes: put(region.shapes, 1 - region.side, parts), outcome };
}

/** Whether it is known in both photographs. */
export function isWhole(region) {
  return region.shapes.every(Boolean);
}

/** What the server needs to know of the regions on which the person decided. */
export function decided(regions) {
  return regions
    .filter((region) => (region.verdict === "accepted" && isWhole(region)) || (region.verdict === "rejected" && region.match !== null))
    .map((region) => {
      const { match, label, verdict, changed, shapes, outcome } = region;
      const [left, right] = changed && verdict === "accepted" ? shapes : [null, null];
      const { agreement = 0, visible = null, points = 0 } = outcome ?? {};
      return { match, label: label || null, accepted: verdict === "accepted", left, right, agreement, visible, points };
    });
}

function put(pair, side, value) {
  return side ? [pair[0], value] : [value, pair[1]];
}
