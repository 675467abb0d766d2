// Beside the photographs: the selected region close up, and the list of all.

import { chip } from "#report/detail.js";
import { make, shown } from "#report/dom.js";
import { colorOf, isWhole } from "#app/regions.js";

const HINTS = {
  point: ["Click on anything in one photograph: its outline appears there, and in the other photograph.", "Click again to add to it; right-click, or Alt and click, takes away."],
  box: ["Draw a box around anything in one photograph.", "With a region selected, a box draws it anew there."],
  outline: ["Click around a region; close it at its first point, or with Enter.", "Esc gives up."],
  edit: ["Click on a region to select it. Drag its corners, or its edges for a new corner.", "Alt and click removes a corner."],
};
const SIDES = ["left", "right"];

/** Writes the selected region, or a hint. on: {verdict(region, verdict), size(side, step), anew(side), label(text), again()}. */
export function showRegion(element, region, page) {
  if (!region) {
    element.replaceChildren(...HINTS[page.tool].map((text) => make("p", { class: "hint" }, text)));
    return;
  }
  const label = make("input", { type: "search", class: "label-field", placeholder: "label", value: region.label, "aria-label": "Label", maxlength: 200 });
  label.addEventListener("change", () => page.on.label(label.value));
  element.replaceChildren(
    make("h2", {}, swatch(region), `Region ${region.number}`, label),
    make("div", { class: "chips" }, [0, 1].map((side) => make("div", {}, region.shapes.some(Boolean) ? chip(page.itemOf(region), side, page) : make("figure", { class: "chip none" }), choices(region, side, page)))),
    status(region, page),
    decisions(region, page),
  );
}

function choices(region, side, page) {
  const answers = region.sizes[side];
  const button = (text, step, title) => make("button", { type: "button", title, disabled: answers.size + step < 0 || answers.size + step >= answers.sizes, onclick: () => page.on.size(side, step) }, text);
  const several = answers && answers.sizes > 1 && region.waiting === null;
  const anew = region.prompts[side].points.length + (region.prompts[side].box ? 1 : 0) > 0;
  return make(
    "div",
    { class: "choices" },
    several ? [button("Smaller", -1, "key ["), button("Larger", 1, "key ]")] : null,
    anew && side !== region.side ? make("button", { type: "button", title: "Take the carried outline again", onclick: () => page.on.again() }, "As carried") : null,
  );
}

function status(region, page) {
  if (region.waiting !== null) return make("p", { class: "why busy" }, `Looking for it ${region.shapes[region.side] ? `in the ${SIDES[1 - region.side]} photograph` : ""} …`);
  if (region.failed) return make("p", { class: "why warnings" }, region.failed, " ", make("button", { type: "button", onclick: () => page.on.again() }, "Try again"));
  const { outcome } = region;
  if (!outcome) return make("p", { class: "why" });
  const sure = outcome.confidence === null || !isWhole(region) ? "" : `, confidence ${shown(outcome.confidence, 2)}`;
  return make("p", { class: "why" }, make("b", {}, outcome.status), `${sure}. ${sentence(outcome.reason)}`);
}

function sentence(text) {
  return text ? `${text[0].toUpperCase()}${text.slice(1)}.` : "";
}

function decisions(region, page) {
  const button = (name, text, key, disabled) =>
    make("button", { type: "button", class: name, "aria-pressed": region.verdict === name, disabled, title: `key ${key}`, onclick: () => page.on.verdict(region, name) }, text);
  return make("div", { class: "verdict" }, button("accepted", "✓ Accept", "Enter", !isWhole(region) || region.waiting !== null), button("rejected", "✗ Reject", "Delete", false));
}

function swatch(region) {
  const found = make("i", { class: "swatch" });
  found.style.background = colorOf(region);
  return found;
}

/** Writes the list. */
export function showList(element, regions, selected, on) {
  element.replaceChildren(
    ...regions.map((region) =>
      make(
        "li",
        { class: `entry ${region.verdict}`, "data-key": region.key },
        make(
          "button",
          { type: "button", "aria-pressed": region.key === selected, onclick: () => on.select(region.key) },
          swatch(region),
          make("b", {}, String(region.number)),
          make("span", { class: "what" }, region.label || (region.waiting !== null ? "…" : (region.failed ? "no answer" : (region.outcome?.status ?? "")))),
          make("span", { class: "sure" }, confidence(region)),
          make("span", { class: "said", "aria-label": region.verdict || "no verdict" }, { accepted: "✓", rejected: "✗" }[region.verdict] ?? ""),
        ),
      ),
    ),
  );
  element.querySelector('[aria-pressed="true"]')?.scrollIntoView({ block: "nearest" });
}

function confidence(region) {
  return isWhole(region) && region.outcome && region.outcome.confidence !== null ? shown(region.outcome.confidence, 2) : "–";
}
