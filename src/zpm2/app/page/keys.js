// The keyboard.

import { the } from "#report/dom.js";
import { connectKeys } from "#report/shell.js";
import { TOOLS } from "#app/tools.js";

export function onKeys(app) {
  const side = () => app.selected?.side ?? 0;
  const middle = (panel) => [panel.width / 2, panel.height / 2];
  const actions = {
    Enter: () => app.tools.close() || app.judge(app.selected, "accepted"),
    Delete: () => app.judge(app.selected, "rejected"),
    Backspace: () => app.judge(app.selected, "rejected"),
    Escape: () => app.tools.cancel() || app.select(""),
    n: () => app.select(""),
    "[": () => app.otherSize(side(), -1),
    "]": () => app.otherSize(side(), 1),
    ArrowDown: () => app.step(1),
    ArrowUp: () => app.step(-1),
    j: () => app.step(1),
    k: () => app.step(-1),
    u: () => app.undo(),
    "+": () => app.zoom(app.panels[0], middle(app.panels[0]), 1.25),
    "-": () => app.zoom(app.panels[0], middle(app.panels[0]), 0.8),
    0: () => app.fit(),
    d: () => app.turnTheme(),
  };
  TOOLS.forEach((tool, k) => (actions[String(k + 1)] = () => app.use(tool)));
  connectKeys(actions);
  addEventListener("keydown", (event) => {
    const typing = event.target.matches("input[type=search]");
    if (typing || the("help").open || !(event.ctrlKey || event.metaKey) || event.altKey || event.key.toLowerCase() !== "z") return;
    event.preventDefault();
    if (event.shiftKey) app.redo();
    else app.undo();
  });
}
