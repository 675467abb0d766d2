// A part of a photograph on a canvas of its own.

const AROUND = 0.35; // of the longer side of what is shown, on each side of it
const LEAST = 24; // px of the photograph, the least side

/** Paints the surroundings of a place. size: [width, height] screen px. extent: [width, height] px of the photograph of what
 * is there. polygon: whose outline is drawn, or null. */
export function closeUp(canvas, panel, size, center, extent, polygon) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = size;
  [canvas.width, canvas.height] = [width * ratio, height * ratio];
  const around = 2 * AROUND * Math.max(...extent);
  const near = Math.min(width / Math.max(extent[0] + around, LEAST), height / Math.max(extent[1] + around, LEAST));
  const whole = Math.min(width / panel.side.width, height / panel.side.height);
  const zoom = Math.max(near, whole);
  const middle = [within(center[0], width / zoom, panel.side.width), within(center[1], height / zoom, panel.side.height)];
  const context = canvas.getContext("2d");
  context.setTransform(ratio * zoom, 0, 0, ratio * zoom, ratio * (width / 2 - zoom * middle[0]), ratio * (height / 2 - zoom * middle[1]));
  context.imageSmoothingQuality = "high";
  context.drawImage(panel.picture, 0, 0, panel.side.width, panel.side.height);
  const half = [width / zoom / 2, height / zoom / 2];
  panel.tiles?.draw(context, [middle[0] - half[0], middle[1] - half[1], middle[0] + half[0], middle[1] + half[1]], zoom * ratio);
  if (!polygon) return;
  for (const [line, color] of [[3.5, "rgba(0, 0, 0, 0.6)"], [1.5, "#ffe14d"]]) {
    context.lineWidth = line / zoom;
    context.strokeStyle = color;
    context.stroke(polygon.path);
  }
}

/** The middle of a stretch that is shown, moved so that nothing beyond the border is; of all, where it is longer. */
export function within(middle, length, whole) {
  return length >= whole ? whole / 2 : Math.max(length / 2, Math.min(whole - length / 2, middle));
}

/** Width and height of a box. */
export function sizeOf(box) {
  return [box[2] - box[0], box[3] - box[1]];
}
