// What the curtain and blink are aligned by, in words.

import { shown } from "#report/dom.js";

export const WAYS = { points: "homologous points", epipolar: "epipolar lines", homography: "homography" };

const MEANING = {
  points: "Aligned by homologous points: each lies on its partner, and what is between them moves in proportion.",
  epipolar: "Rectified, in the frame of the left photograph: everything moves along its epipolar line only.",
  homography: "Aligned by the homography: what lies off its plane is displaced.",
};

/** A sentence on an alignment, and how well it fits. */
export function comparison(how, { within, most }) {
  const far = within[how];
  if (far === undefined || far === null) return MEANING[how];
  return `${MEANING[how]} ${shown(100 * most)} % of the points are within ${shown(far, far < 10 ? 1 : 0)} px.`;
}
