// What the page shows, as one object, and the same as the fragment of the address: a link that shows it again.

export const DEFAULTS = Object.freeze({
  select: "", // key of an item
  mode: "side", // side, curtain, blink
  align: "", // what curtain and blink are aligned by; empty: the first of the others that there is
  color: "match", // match, confidence, stage, why
  tab: "list", // list, run
  show: "all", // all, matched, unmatched, left, right
  hide: Object.freeze([]), // stages and reasons
  min: 0, // confidence
  max: 1,
  least: 0, // area, px^2
  most: 0, // 0: no limit
  text: "", // a part of a label, or an id
  sort: "id",
  down: false,
  fill: 30, // opacity in percent
  numbers: true,
  line: true, // the epipolar line of the cursor
  link: true, // zoom both photographs together
  theme: "", // light, dark; empty: as the system
});

/** The same of the report of tracks. */
export const TRACKS = Object.freeze({
  select: "", // key of a track
  color: "match", // match, confidence
  tab: "list", // list, run
  photographs: 1, // the least number of a track
  min: 0, // of its lowest confidence
  max: 1,
  carried: false, // only tracks with carried regions
  text: "", // an id, or a part of a photograph's name
  sort: "length",
  fill: 30, // opacity in percent
  numbers: true,
  across: 2, // photographs in a row
  theme: "",
});

/** The same of the page of a cloud. */
export const CLOUD = Object.freeze({
  select: "", // key of a polygon
  color: "match", // match, confidence
  patches: true, // what is shown
  tubes: true,
  surface: true,
  min: 0, // confidence
  text: "", // an id, or a part of a label or of a photograph's name
  sort: "id",
  down: false,
  theme: "",
});

const CHOICES = {
  mode: ["side", "curtain", "blink"],
  align: ["", "points", "epipolar", "homography"],
  color: ["match", "confidence", "stage", "why"],
  tab: ["list", "run"],
  show: ["all", "matched", "unmatched", "left", "right"],
  sort: ["id", "label", "area", "confidence", "cost", "dsf", "stage", "verdict", "length", "weakest", "planarity", "seen"],
  theme: ["", "light", "dark"],
};

/** The fragment of a state, without #: what differs from the defaults. */
export function toFragment(state, defaults = DEFAULTS) {
  const words = new URLSearchParams();
  for (const [name, usual] of Object.entries(defaults)) {
    const value = Array.isArray(usual) ? state[name].join(",") : String(state[name]);
    if (value !== (Array.isArray(usual) ? usual.join(",") : String(usual))) words.set(name, value);
  }
  return words.toString();
}

/** The state that a fragment describes. Unknown names and values that do not fit are left out. */
export function fromFragment(fragment, defaults = DEFAULTS) {
  const state = { ...defaults };
  for (const [name, value] of new URLSearchParams(fragment.replace(/^#/, ""))) {
    const usual = Object.hasOwn(defaults, name) ? defaults[name] : undefined;
    if (Array.isArray(usual)) state[name] = value.split(",").filter(Boolean);
    else if (typeof usual === "boolean") state[name] = value === "true";
    else if (typeof usual === "number") state[name] = Number.isFinite(Number(value)) ? Number(value) : usual;
    else if (typeof usual === "string" && (CHOICES[name] ?? [value]).includes(value)) state[name] = value;
  }
  return state;
}
