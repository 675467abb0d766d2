// The controls around the photographs and the table: each shows a member of the state and changes it.

import { make, shown, the } from "#report/dom.js";
import { csv, offer, readVerdicts, unpacked, verdictsDocument } from "#report/downloads.js";
import { CONFIDENCE, STAGES } from "#report/items.js";
import { connectReset, connectState } from "#report/shell.js";
import { DEFAULTS } from "#report/state.js";

/** Check boxes for the stages and reasons that occur. */
export function listChoices(report) {
  const counts = new Map();
  for (const item of report.items) counts.set(item.stage ?? item.why, (counts.get(item.stage ?? item.why) ?? 0) + 1);
  const order = [...Object.keys(STAGES), ...Object.keys(report.reasons)];
  const names = [...counts.keys()].sort((a, b) => order.indexOf(a) - order.indexOf(b));
  the("chosen").append(
    ...names.map((name) => {
      const box = make("input", { type: "checkbox", value: name, onchange: () => toggleHidden(report, name) });
      return make("label", {}, box, `${name} `, make("small", {}, shown(counts.get(name))));
    }),
  );
}

function toggleHidden(report, name) {
  const { hide } = report.state;
  report.set({ hide: hide.includes(name) ? hide.filter((each) => each !== name) : [...hide, name] });
}

/** Makes all controls work. */
export function connectControls(report) {
  connectState(DEFAULTS, (changes) => report.set(changes));
  connectReset(DEFAULTS, ["show", "hide", "min", "max", "least", "most", "text"], (changes) => report.set(changes));
  for (const tab of ["list", "run"]) the(`tab-${tab}`).addEventListener("click", () => report.set({ tab }));
  the("theme").addEventListener("click", () => report.turnTheme());
  the("fit").addEventListener("click", () => report.fit());
  the("play").addEventListener("click", () => report.play(!report.playing));
  for (const button of document.querySelectorAll("[data-offer]")) {
    button.addEventListener("click", () => give(report, button.dataset.offer));
  }
  the("load").addEventListener("change", async ({ target }) => {
    try {
      const found = readVerdicts(await target.files[0].text(), report.items);
      report.saved.replace({ ...report.verdicts, ...found });
      the("offer-note").textContent = `${Object.keys(found).length} verdicts loaded`;
    } catch (error) {
      the("offer-note").textContent = `Not loaded: ${error.message}`;
    }
    target.value = "";
    report.adopt(report.state);
  });
}

async function give(report, what) {
  if (what === "table") offer("matches.csv", "text/csv", csv(report.listed, report.verdicts));
  if (what === "verdicts") {
    const document = verdictsDocument(report.data, report.items, report.verdicts);
    offer("verdicts.json", "application/json", `${JSON.stringify(document, null, 1)}\n`);
  }
  if (what !== "result") return;
  const packed = the("document").textContent;
  if (packed) offer(report.data.document, "application/json", await unpacked(packed, the("timings").textContent));
  else window.open(report.data.document); // a large one lies beside the page
}

/** What the colours mean. */
export function showLegend(report) {
  const entry = (color, text) => {
    const swatch = make("i", { class: "swatch" });
    swatch.style.background = color;
    return make("span", {}, swatch, text);
  };
  const { color } = report.state;
  const stages = new Set(report.items.map((item) => item.stage));
  const whys = new Set(report.items.map((item) => item.why).filter(Boolean));
  the("legend").replaceChildren(
    ...(color === "match" ? [make("span", {}, "same colour, same surface")] : []),
    ...(color === "confidence" ? CONFIDENCE.map(([least, value]) => entry(value, least ? `from ${least}` : "less")) : []),
    ...(color === "stage" ? Object.entries(STAGES).filter(([name]) => stages.has(name)).map(([name, value]) => entry(value, name)) : []),
    ...(color === "why" ? Object.entries(report.reasons).filter(([name]) => whys.has(name)).map(([name, value]) => entry(value, name)) : []),
    ...(color === "why" ? [] : [entry("#d6d6d6", "not matched")]),
  );
}
