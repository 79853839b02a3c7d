// What a ray hits among splats. Positions and distances: metres, in the map's coordinates.
import { RECORD } from './splats.js';

const FLOATS = RECORD / 4;
// Fainter contributions do not count; a ray has hit when so much of it is left.
const FAINTEST = 0.02;
const HALF = 0.5;

// Distance along a ray (unit direction) to where the splats have stopped half of it; null if they never do. Splats
// for which `isHidden(index)` holds stop nothing.
export function hit({ floats, bytes, count }, [ox, oy, oz], [dx, dy, dz], isHidden) {
  const passed = [];
  for (let at = 0; at < count; at += 1) {
    const f = at * FLOATS;
    const [x, y, z] = [floats[f] - ox, floats[f + 1] - oy, floats[f + 2] - oz];
    const along = x * dx + y * dy + z * dz;
    const reach = 3 * Math.max(floats[f + 3], floats[f + 4], floats[f + 5]);
    if (along < 0.05 || isHidden(at) || x * x + y * y + z * z - along * along > reach * reach) continue;
    const opacity = bytes[at * RECORD + 27] / 255;
    const { distance, share } = crossing(floats, bytes, at, [x, y, z], [dx, dy, dz]);
    if (opacity * share > FAINTEST && distance > 0) passed.push([distance, opacity * share]);
  }
  passed.sort(([a], [b]) => a - b);
  let left = 1;
  for (const [distance, opacity] of passed) {
    left *= 1 - opacity;
    if (left < HALF) return distance;
  }
  return null;
}

// Where a ray from the origin is deepest in a splat at `center`, and the share of its opacity there.
function crossing(floats, bytes, at, center, direction) {
  const [w, x, y, z] = [28, 29, 30, 31].map((byte) => (bytes[at * RECORD + byte] - 128) / 128);
  const norm = w * w + x * x + y * y + z * z || 1;
  const axes = [
    [w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)],
    [2 * (x * y - w * z), w * w - x * x + y * y - z * z, 2 * (y * z + w * x)],
    [2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z],
  ];
  let [dd, dc, cc] = [0, 0, 0];
  axes.forEach((axis, of) => {
    const scale = Math.max(floats[at * FLOATS + 3 + of], 1e-4) * norm;
    const d = (axis[0] * direction[0] + axis[1] * direction[1] + axis[2] * direction[2]) / scale;
    const c = (axis[0] * center[0] + axis[1] * center[1] + axis[2] * center[2]) / scale;
    dd += d * d;
    dc += d * c;
    cc += c * c;
  });
  return { distance: dc / dd, share: Math.exp(-0.5 * (cc - (dc * dc) / dd)) };
}
