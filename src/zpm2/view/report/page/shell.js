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
    if (target.matches("input:not([type=checkbox], [type=radio]), select, textarea")) {
      if (event.key === "Escape") target.blur();
      return;
    }
    if (target.matches("button, summary, input, label") && [" ", "Enter"].includes(event.key)) return;
    if (target.matches("input[type=radio]") && event.key.startsWith("Arrow")) return;
    const action = Object.hasOwn(all, event.key) ? all[event.key] : null;
    if (!action) return;
    event.preventDefault();
    action();
  });
}
