// The tab about the run: messages, geometry, timings and configuration.

import { make, shown } from "#report/dom.js";

/** Fills the tab for a pair. */
export function showRun(element, data) {
  const { run } = data;
  const facts = [
    ["zpm2", run.version],
    ["Same scene", run.same_scene === null || run.same_scene === undefined ? "not estimated" : `probability ${shown(run.same_scene, 2)}`],
    ["Fundamental matrix", data.fundamental.matrix ? "estimated" : data.fundamental.failed],
    ["Homography", data.homography.matrix ? "estimated" : data.homography.failed],
    ...data.sides.map((side) => [side.name === "left" ? "Left" : "Right", `${side.path ?? "given as pixels"}, ${side.width} × ${side.height} px`]),
  ];
  showFacts(element, facts, run, data.timings);
}

/** Fills the tab: names and values of facts, what the run said, seconds by stage, and its configuration. */
export function showFacts(element, facts, run, timings) {
  const total = Object.values(timings).reduce((sum, value) => sum + value, 0);
  element.replaceChildren(
    ...messages("Warnings", run.warnings, "warnings"),
    make("h3", {}, "Result"),
    make("table", {}, facts.map(([name, value]) => make("tr", {}, make("th", { scope: "row" }, name), make("td", {}, String(value))))),
    ...messages("Notes", run.notes, "notes"),
    make("h3", {}, `Timings: ${shown(total, 1)} s`),
    make("table", { class: "timings" }, Object.entries(timings).map(([stage, seconds]) => timing(stage, seconds, total))),
    make("h3", {}, "Configuration"),
    make("pre", {}, JSON.stringify(run.config, null, 2)),
  );
}

function messages(title, texts, kind) {
  if (!texts?.length) return [];
  return [make("h3", {}, title), make("ul", { class: kind }, texts.map((text) => make("li", {}, text)))];
}

function timing(stage, seconds, total) {
  const bar = make("i", { class: "bar" });
  bar.style.width = `${(100 * seconds) / (total || 1)}%`;
  return make("tr", {}, make("th", { scope: "row" }, stage), make("td", {}, shown(seconds, 2)), make("td", { class: "bars" }, bar));
}
