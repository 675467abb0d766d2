// What the page shows, as one object, and the same as the fragment of the address: a link that shows it again.

export const DEFAULTS = Object.freeze({
  select: "", // key of an item
  mode: "side", // side, curtain, blink
  align: "points", // what curtain and blink are aligned by
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

const CHOICES = {
  mode: ["side", "curtain", "blink"],
  align: ["points", "homography"],
  color: ["match", "confidence", "stage", "why"],
  tab: ["list", "run"],
  show: ["all", "matched", "unmatched", "left", "right"],
  sort: ["id", "label", "area", "confidence", "cost", "dsf", "stage", "verdict"],
  theme: ["", "light", "dark"],
};

/** The fragment of a state, without #: what differs from the defaults. */
export function toFragment(state) {
  const words = new URLSearchParams();
  for (const [name, usual] of Object.entries(DEFAULTS)) {
    const value = Array.isArray(usual) ? state[name].join(",") : String(state[name]);
    if (value !== (Array.isArray(usual) ? usual.join(",") : String(usual))) words.set(name, value);
  }
  return words.toString();
}

/** The state that a fragment describes. Unknown names and values that do not fit are left out. */
export function fromFragment(fragment) {
  const state = { ...DEFAULTS };
  for (const [name, value] of new URLSearchParams(fragment.replace(/^#/, ""))) {
    const usual = Object.hasOwn(DEFAULTS, name) ? DEFAULTS[name] : undefined;
    if (Array.isArray(usual)) state[name] = value.split(",").filter(Boolean);
    else if (typeof usual === "boolean") state[name] = value === "true";
    else if (typeof usual === "number") state[name] = Number.isFinite(Number(value)) ? Number(value) : usual;
    else if (typeof usual === "string" && (CHOICES[name] ?? [value]).includes(value)) state[name] = value;
  }
  return state;
}
