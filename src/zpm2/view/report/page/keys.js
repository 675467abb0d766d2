// The keyboard.

import { connectKeys } from "#report/shell.js";

const COLORS = ["match", "confidence", "stage", "why"];
const CURTAIN = 0.02; // of the panel's width, a step of the curtain

export function onKeys(report) {
  const { panels } = report;
  const toggle = (name) => report.set({ [name]: !report.state[name] });
  const middle = (panel) => [panel.width / 2, panel.height / 2];
  const slide = (step) => {
    if (report.state.mode !== "curtain") return;
    panels[0].edge = Math.max(0.01, Math.min(0.99, panels[0].edge + step));
    report.refresh();
  };
  const actions = {
    ArrowDown: () => report.step(1),
    ArrowUp: () => report.step(-1),
    j: () => report.step(1),
    k: () => report.step(-1),
    Enter: () => report.zoomTo(report.chosen),
    Escape: () => report.choose(null),
    y: () => report.judge(report.chosen, "right"),
    n: () => report.judge(report.chosen, "wrong"),
    1: () => report.set({ mode: "side" }),
    2: () => report.set({ mode: "curtain" }),
    3: () => report.set({ mode: "blink" }),
    ArrowLeft: () => slide(-CURTAIN),
    ArrowRight: () => slide(CURTAIN),
    " ": () => {
      if (report.state.mode !== "blink") return;
      report.play(false);
      report.blink();
    },
    c: () => report.set({ color: COLORS[(COLORS.indexOf(report.state.color) + 1) % COLORS.length] }),
    "+": () => report.zoom(panels[0], middle(panels[0]), 1.25),
    "-": () => report.zoom(panels[0], middle(panels[0]), 0.8),
    0: () => report.fit(),
    e: () => toggle("line"),
    i: () => toggle("numbers"),
    l: () => toggle("link"),
    d: () => report.turnTheme(),
    "/": () => {
      report.set({ tab: "list" });
      document.querySelector('[data-state="text"]').focus();
    },
  };
  connectKeys(actions);
}
