// The map from above, for the plan: its splats without what is over the cameras.
import { RECORD, splats } from './splats.js';

const FLOATS = RECORD / 4;
// The most important splats are enough, and faint ones hide what is under them.
const MOST = 60_000;
const FAINTEST = 90;
// What is higher above the middle of the cameras' path is cut away, metres: ceilings and lamps.
const CUT = 0.1;
// Lines are drawn over it.
const BRIGHTNESS = 0.75;
const LARGEST_PIXELS = 10;
// Outliers do not count for the extent.
const OUTSIDE = 0.01;

let last = { key: null, canvas: null };

// The extent of the splats on a plane, two axes of the map; null without splats.
export function extent([across, up]) {
  const { floats, count } = splats();
  if (count === 0) return null;
  const step = Math.ceil(count / 5000);
  const range = (axis) => {
    const sorted = Float32Array.from({ length: Math.floor(count / step) }, (_, at) => floats[at * step * FLOATS + axis]).sort();
    return [sorted[Math.floor(sorted.length * OUTSIDE)], sorted[Math.floor((sorted.length - 1) * (1 - OUTSIDE))]];
  };
  const [x, y] = [range(across), range(up)];
  return { least: [x[0], y[0]], most: [x[1], y[1]] };
}

// A picture of the map, as large as the plan. `pixel` takes coordinates on the plane to pixels, `scale` is pixels a
// metre. `above`: the axis across the plane with the sign that points up, and the height of the cameras if it is the
// floor that is shown.
export function picture({ width, height }, axes, above, pixel, scale) {
  const all = splats();
  const count = Math.min(all.count, MOST);
  if (count === 0) return null;
  const key = [all.etag, all.count, width, axes, above.axis, above.cameras?.toFixed(1), pixel([0, 0]), scale].join();
  if (last.key === key) return last.canvas;
  const image = new ImageData(width, height);
  const heights = new Float32Array(width * height).fill(-Infinity);
  const cut = above.cameras === null ? Infinity : above.cameras + CUT;
  for (let at = 0; at < count; at += 1) {
    const f = at * FLOATS;
    const b = at * RECORD + 24;
    const tall = above.sign * all.floats[f + above.axis];
    if (tall > cut || all.bytes[b + 3] < FAINTEST) continue;
    const [x, y] = pixel([all.floats[f + axes[0]], all.floats[f + axes[1]]]).map(Math.round);
    const reach = Math.min(LARGEST_PIXELS, Math.round(2 * scale * Math.max(all.floats[f + 3], all.floats[f + 4], all.floats[f + 5])));
    for (let row = Math.max(0, y - reach); row <= Math.min(height - 1, y + reach); row += 1) {
      for (let column = Math.max(0, x - reach); column <= Math.min(width - 1, x + reach); column += 1) {
        const place = row * width + column;
        if ((row - y) ** 2 + (column - x) ** 2 > reach * reach + 1 || heights[place] > tall) continue;
        heights[place] = tall;
        image.data.set([BRIGHTNESS * all.bytes[b], BRIGHTNESS * all.bytes[b + 1], BRIGHTNESS * all.bytes[b + 2], 255], place * 4);
      }
    }
  }
  const canvas = Object.assign(document.createElement('canvas'), { width, height });
  canvas.getContext('2d').putImageData(image, 0, 0);
  last = { key, canvas };
  return canvas;
}
