// What the person said of matches, kept by the browser for this result.

export class Verdicts {
  constructor(data) {
    this.name = nameOf(data);
    this.of = {}; // item key -> "right" or "wrong"
    try {
      Object.assign(this.of, JSON.parse(localStorage.getItem(this.name) ?? "{}"));
    } catch {
      // a browser that keeps nothing for pages from disk, or what another program left: the verdicts last as long as the page
    }
  }

  /** verdict: "right", "wrong", or null for none. */
  set(key, verdict) {
    if (verdict) this.of[key] = verdict;
    else delete this.of[key];
    this.keep();
  }

  replace(verdicts) {
    for (const key of Object.keys(this.of)) delete this.of[key];
    Object.assign(this.of, verdicts);
    this.keep();
  }

  keep() {
    try {
      localStorage.setItem(this.name, JSON.stringify(this.of));
    } catch {
      // as above
    }
  }
}

/** A name that another result, with other polygons or matches of the same photographs, does not have. */
export function nameOf({ sides, matches }) {
  const photographs = sides.map(({ path, width, height }) => [path, width, height]);
  const text = JSON.stringify([sides.map((side) => side.polygons.map(({ id, area }) => [id, area])), matches.map((m) => [m.left, m.right])]);
  let hash = 0x811c9dc5; // FNV-1a, 32 bits
  for (let k = 0; k < text.length; k++) hash = Math.imul(hash ^ text.charCodeAt(k), 0x01000193) >>> 0;
  return `zpm2-verdicts ${hash.toString(16)} ${JSON.stringify(photographs)}`;
}
