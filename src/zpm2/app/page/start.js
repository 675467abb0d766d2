// The page before there are two photographs: drop them, or choose them.

import { make, the } from "#report/dom.js";

const SIDES = ["left", "right"];

/** Resolves with the state of the server when both photographs are there. */
export function twoPhotographs(server, first, say) {
  the("start").hidden = false;
  return new Promise((done) => {
    let state = first;
    const show = () => SIDES.forEach((side, k) => showSlot(server, side, state.photographs[k]));
    const send = async (k, file) => {
      if (file.size > state.most) {
        say(`${file.name} is too large: zpm2 app --max-upload SIZE takes larger ones.`);
        return;
      }
      say(`Reading ${file.name} …`);
      try {
        state = { ...state, ...(await server.send(`/api/photograph/${SIDES[k]}?name=${encodeURIComponent(file.name)}`, file)) };
        say("");
      } catch (error) {
        say(error.message);
      }
      show();
      if (state.photographs.every(Boolean)) {
        the("start").hidden = true;
        done(state);
      }
    };
    const take = async (k, files) => {
      // of two files dropped at once, the first is the left one
      const some = [...files].slice(0, 2);
      if (some.length === 2) for (const [n, file] of some.entries()) await send(n, file);
      else if (some.length) await send(k, some[0]);
    };
    SIDES.forEach((side, k) => {
      const slot = the(`slot-${side}`);
      slot.querySelector("input").onchange = ({ target }) => take(k, target.files).finally(() => (target.value = ""));
      slot.ondragover = (event) => {
        event.preventDefault();
        slot.classList.add("over");
      };
      slot.ondragleave = () => slot.classList.remove("over");
      slot.ondrop = (event) => {
        event.preventDefault();
        slot.classList.remove("over");
        take(k, event.dataTransfer.files);
      };
    });
    show();
  });
}

async function showSlot(server, side, photograph) {
  const shown = the(`slot-${side}`).querySelector(".shown");
  if (!photograph) return;
  const picture = make("img", { alt: "" });
  picture.src = URL.createObjectURL(await server.blob(`/api/photograph/${side}`));
  shown.replaceChildren(picture, make("span", {}, photograph.name));
}
