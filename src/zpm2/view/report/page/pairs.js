// The page of many pairs.

import { make, shown, the } from "#report/dom.js";
import { ordered } from "#report/rows.js";
import { keepAddress, otherTheme } from "#report/shell.js";

const data = JSON.parse(the("data").textContent);
const state = { sort: "", down: false, text: "" };

function show() {
  const header = ([name, title, meaning]) => {
    const arrow = state.sort === name ? (state.down ? " ▾" : " ▴") : "";
    const sorted = state.sort === name ? (state.down ? "descending" : "ascending") : "none";
    const click = () => {
      state.down = state.sort === name && !state.down;
      state.sort = name;
      keep();
    };
    return make("th", { scope: "col", "aria-sort": sorted }, make("button", { type: "button", title: meaning, onclick: click }, title + arrow));
  };
  the("head").replaceChildren(
    make("th", {}),
    header(["name", "Pair", "name"]),
    ...data.columns.map(({ name, title, meaning }) => header([name, title, meaning])),
  );
  the("rows").replaceChildren(...ordered(data.rows, state).map(row));
}

function row({ name, link, remark, thumbnail, values }) {
  const picture = thumbnail && make("img", { src: thumbnail, alt: "", loading: "lazy" });
  const to = (child) => (link ? make("a", { href: link }, child) : child);
  return make(
    "tr",
    {},
    make("td", {}, picture && to(picture)),
    make("td", {}, to(name), remark && make("p", { class: "remark" }, remark)),
    data.columns.map((column) => make("td", { class: "number" }, shown(values[column.name], column.digits))),
  );
}

function keep() {
  const words = new URLSearchParams(Object.entries(state).filter(([, value]) => value).map(([name, value]) => [name, String(value)]));
  keepAddress(String(words));
  show();
}

function adopt() {
  const words = new URLSearchParams(location.hash.slice(1));
  Object.assign(state, { sort: words.get("sort") ?? "", down: words.get("down") === "true", text: words.get("text") ?? "" });
  the("search").value = state.text;
  show();
}

the("search").addEventListener("input", ({ target }) => {
  state.text = target.value;
  keep();
});
the("theme").addEventListener("click", () => {
  const { dataset } = document.documentElement;
  dataset.theme = otherTheme(dataset);
});
addEventListener("hashchange", adopt);
adopt();
document.documentElement.dataset.ready = String(Math.round(performance.now()));
