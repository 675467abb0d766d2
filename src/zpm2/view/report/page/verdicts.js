// What the person said of matches, kept by the browser for this pair of photographs.

export class Verdicts {
  constructor(data) {
    const photographs = data.sides.map((side) => [side.path, side.width, side.height, side.polygons.length]);
    this.name = `zpm2-verdicts ${JSON.stringify(photographs)}`;
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
