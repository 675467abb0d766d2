// What all pages with a state have in common: their controls, keys and theme.

import { the } from "#report/dom.js";

/** Every element with data-state changes a member of the state. defaults: of the page; set: takes the changes. */
export function connectState(defaults, set) {
  for (const element of document.querySelectorAll("[data-state]")) {
    const name = element.dataset.state;
    element.addEventListener("input", () => {
      if (element.type === "checkbox") set({ [name]: element.checked });
      else if (typeof defaults[name] === "number") set({ [name]: element.value === "" ? defaults[name] : Number(element.value) });
      else set({ [name]: element.value });
    });
  }
  the("filters").addEventListener("submit", (event) => event.preventDefault());
  the("help-button").addEventListener("click", () => the("help").showModal());
}

/** Every element with data-state shows a member of the state; the page has its theme. */
export function showState(state) {
  document.documentElement.dataset.theme = state.theme;
  for (const element of document.querySelectorAll("[data-state]")) {
    const value = state[element.dataset.state];
    if (element.type === "checkbox") element.checked = value;
    else if (element.type === "radio") element.checked = element.value === value;
    else if (element !== document.activeElement) element.value = value === 0 && element.placeholder ? "" : value;
  }
}

/** The reset button of the filters sets these members of the state again. */
export function connectReset(defaults, names, set) {
  the("filters").addEventListener("reset", (event) => {
    event.preventDefault();
    set(Object.fromEntries(names.map((name) => [name, defaults[name]])));
  });
}

/** Tabs show the section of the state's `tab`. */
export function showTab(tabs, shown) {
  for (const tab of tabs) {
    the(tab).hidden = shown !== tab;
    the(`tab-${tab}`).setAttribute("aria-selected", shown === tab);
  }
}

/** The address that links to a state. */
export function keepAddress(fragment) {
  history.replaceState(null, "", fragment ? `#${fragment}` : location.pathname + location.search);
}

/** The item that lies so many rows from that with a key; the first or the last one where none has it, null of none. */
export function stepped(items, key, rows) {
  const at = items.findIndex((item) => item.key === key);
  const next = at < 0 ? (rows > 0 ? 0 : items.length - 1) : Math.max(0, Math.min(items.length - 1, at + rows));
  return items[next] ?? null;
}

/** A button that leads to the warnings of a run, where there are any. */
export function showAlert(run, open) {
  const warnings = run.warnings?.length ?? 0;
  the("alert").hidden = !warnings;
  the("alert").textContent = `⚠ ${warnings} ${warnings === 1 ? "warning" : "warnings"}`;
  the("alert").addEventListener("click", open);
}

/** The theme that differs from the one now seen. */
export function otherTheme(state) {
  const dark = state.theme ? state.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  return dark ? "light" : "dark";
}

/** actions: by key. Keys that a control needs itself stay with it. */
export function connectKeys(actions) {
  const all = { ...actions, "=": actions["+"], "?": () => the("help").showModal() };
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || the("help").open) return;
    const { target } = event;
    if (target.matches("input:not([type=checkbox], [type=radio], [type=range]), select, textarea")) {
      if (event.key === "Escape" || (event.key === "Enter" && target.type === "search")) target.blur();
      return;
    }
    if (target.matches("button, summary, input, label") && [" ", "Enter"].includes(event.key)) return;
    if (target.matches("input[type=radio], input[type=range]") && event.key.startsWith("Arrow")) return;
    const action = Object.hasOwn(all, event.key) ? all[event.key] : null;
    if (!action) return;
    event.preventDefault();
    action();
  });
}
