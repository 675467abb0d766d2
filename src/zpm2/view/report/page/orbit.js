// A camera that turns around a point. Matrices have 16 numbers by columns, as WebGL takes them.

const STEEPEST = 1.57; // radians

/** The product of two matrices. */
export function times(a, b) {
  return Float32Array.from({ length: 16 }, (_, k) => {
    let sum = 0;
    for (let j = 0; j < 4; j++) sum += a[(k % 4) + 4 * j] * b[4 * Math.floor(k / 4) + j];
    return sum;
  });
}

/** From the frame of the cloud to that of the eye, without its distance. frame: the unit vectors right, up and towards the
 * views. eye: {yaw, pitch (radians; below 0 from above), distance, target: the point that it turns around}. */
export function turned(frame, { yaw, pitch, target }) {
  const [right, up, towards] = frame;
  const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
  const base = [0, 1, 2].flatMap((k) => [right[k], up[k], towards[k], 0]).concat([0, 0, 0, 1]);
  const turn = times([1, 0, 0, 0, 0, cp, -sp, 0, 0, sp, cp, 0, 0, 0, 0, 1], times([cy, 0, -sy, 0, 0, 1, 0, 0, sy, 0, cy, 0, 0, 0, 0, 1], base));
  return times(turn, [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -target[0], -target[1], -target[2], 1]);
}

/** What the eye sees: [to clip space, to the frame of the eye]. opening: radians from top to bottom; aspect: width / height;
 * the cloud lies within 1 of the origin. */
export function seenFrom(frame, eye, opening, aspect) {
  const turn = turned(frame, eye);
  turn[14] -= eye.distance;
  const f = 1 / Math.tan(opening / 2);
  const reach = 2 + Math.hypot(...eye.target);
  const [near, far] = [Math.max(eye.distance / 100, eye.distance - reach), eye.distance + reach];
  const lens = [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0];
  return [times(lens, turn), turn];
}

/** The eye turned by radians. */
export function spun(eye, yaw, pitch) {
  return { ...eye, yaw: eye.yaw + yaw, pitch: Math.max(-STEEPEST, Math.min(STEEPEST, eye.pitch + pitch)) };
}

/** The eye moved so that its target goes by (x, y) in its own frame: x to the right, y up. */
export function moved(frame, eye, x, y) {
  const turn = turned(frame, eye);
  return { ...eye, target: eye.target.map((value, k) => value - x * turn[4 * k] - y * turn[4 * k + 1]) };
}

/** The eye nearer to its target. */
export function nearer(eye, factor) {
  return { ...eye, distance: Math.min(8, Math.max(0.02, eye.distance / factor)) };
}
