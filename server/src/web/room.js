// Extent of what the splats show, metres.
import { RECORD } from './splats.js';

const FLOATS = RECORD / 4;
// The most important splats decide, but for the lowest and the highest few of them.
const SAMPLE = 20_000;
const FEWEST = 0.02;

let last = { of: null, count: 0, room: null };

// {floor, ceiling, center, size} without outliers: heights above the map's origin, the middle, the longest side.
export function roomOf(all, up) {
  const count = Math.min(all.count, SAMPLE);
  if (last.of === all && last.count === count) return last.room;
  const among = (value) => {
    const sorted = Float32Array.from({ length: count }, (_, at) => value(at * FLOATS)).sort();
    return [sorted[Math.floor(count * FEWEST)], sorted[Math.floor((count - 1) * (1 - FEWEST))]];
  };
  const [floor, ceiling] = among((f) => all.floats[f] * up[0] + all.floats[f + 1] * up[1] + all.floats[f + 2] * up[2]);
  const sides = [0, 1, 2].map((axis) => among((f) => all.floats[f + axis]));
  const center = sides.map(([least, most]) => (least + most) / 2);
  const size = Math.max(...sides.map(([least, most]) => most - least));
  last = { of: all, count, room: { floor, ceiling, center, size } };
  return last.room;
}
