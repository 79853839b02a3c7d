// The plan: draws the map, the trajectory and the objects from above.
//
// In: keyframes with world_from_camera (16 numbers, row-major), objects with axis-aligned boxes, metres, and
// the splats. Out: a drawing on a canvas.
import { extent, picture } from './floor.js';

const AXES = { xz: [0, 2], xy: [0, 1], yz: [1, 2] };
const MARGIN = 30;
// Height of the drawing, as a share of its width.
const [FLATTEST, TALLEST] = [0.5, 0.75];

// The plane of the floor, and the axis across it with the sign that points up. The y axis of a camera points
// down, so the world axis that most y axes are parallel to is vertical.
function fromAbove(frames) {
  const down = [0, 0, 0];
  for (const frame of frames) {
    for (const axis of [0, 1, 2]) down[axis] += frame.world_from_camera[axis * 4 + 1];
  }
  const size = down.map(Math.abs);
  const vertical = size.indexOf(Math.max(...size));
  return { plane: { 0: 'yz', 1: 'xz', 2: 'xy' }[vertical], axis: vertical, sign: down[vertical] > 0 ? -1 : 1 };
}

export function drawPlan(canvas, frames, objects, plane, chosen) {
  const context = canvas.getContext('2d');
  const { width } = canvas;
  context.clearRect(0, 0, width, canvas.height);
  const floor = fromAbove(frames);
  const name = plane === 'auto' ? floor.plane : plane;
  const [across, up] = AXES[name];
  const place = (frame) => [frame.world_from_camera[across * 4 + 3], frame.world_from_camera[up * 4 + 3]];
  const path = frames.map(place);
  const corners = objects.flatMap((o) => [[o.aabb_min_metres[across], o.aabb_min_metres[up]], [o.aabb_max_metres[across], o.aabb_max_metres[up]]]);
  const ground = extent(AXES[name]);
  const all = [...path, ...corners, ...(ground ? [ground.least, ground.most] : [])];
  if (all.length === 0) return;

  const least = [0, 1].map((i) => Math.min(...all.map((p) => p[i])));
  const most = [0, 1].map((i) => Math.max(...all.map((p) => p[i])));
  // A flat is rarely as tall as it is wide: the drawing is no taller than it must be.
  const [wide, tall] = [0, 1].map((i) => most[i] - least[i]);
  const height = Math.round(width * Math.min(TALLEST, Math.max(FLATTEST, tall / wide || 0)));
  if (canvas.height !== height) canvas.height = height;
  const span = Math.max(wide, tall * (width / height), 0.5);
  const scale = (width - 2 * MARGIN) / span;
  const middle = [0, 1].map((i) => (least[i] + most[i]) / 2);
  const pixel = ([x, y]) => [width / 2 + (x - middle[0]) * scale, height / 2 - (y - middle[1]) * scale];

  const map = picture(canvas, AXES[name], above(frames, name, floor), pixel, scale);
  if (map) context.drawImage(map, 0, 0);
  grid(context, width, height, scale, pixel([0, 0]));
  context.lineWidth = 2.5;
  context.strokeStyle = '#22d3ee';
  context.beginPath();
  path.map(pixel).forEach(([x, y], at) => (at === 0 ? context.moveTo(x, y) : context.lineTo(x, y)));
  context.stroke();
  frames.forEach((frame, at) => camera(context, frame, pixel(path[at]), [across, up], frame.sequence === chosen));
  objects.forEach((object, at) => box(context, object, at, pixel, [across, up]));
  note(context, `${name[0]} → , ${name[1]} ↑`, 10, height - 10);
}

// A text that can be read on whatever is under it.
function note(context, text, x, y, color = '#a5aec0') {
  context.font = '16px system-ui';
  context.lineJoin = 'round';
  context.lineWidth = 3;
  context.strokeStyle = '#0b0e14';
  context.strokeText(text, x, y);
  context.fillStyle = color;
  context.fillText(text, x, y);
}

// The axis across the plane and the sign that points to who looks at it; `cameras`: the height of the middle
// one above the floor, if it is the floor that is shown.
function above(frames, name, floor) {
  if (name !== floor.plane) return { axis: { yz: 0, xz: 1, xy: 2 }[name], sign: name === 'xz' ? -1 : 1, cameras: null };
  const heights = frames.map((frame) => floor.sign * frame.world_from_camera[floor.axis * 4 + 3]).sort((a, b) => a - b);
  return { ...floor, cameras: heights[heights.length >> 1] ?? null };
}

function grid(context, width, height, scale, [zeroX, zeroY]) {
  const metres = [0.1, 0.25, 0.5, 1, 2, 5, 10, 25, 50, 100, 1000].find((m) => m * scale > 40) ?? 1000;
  const step = metres * scale;
  context.strokeStyle = '#8b95a833';
  context.lineWidth = 1;
  context.beginPath();
  for (let x = ((zeroX % step) + step) % step; x < width; x += step) { context.moveTo(x, 0); context.lineTo(x, height); }
  for (let y = ((zeroY % step) + step) % step; y < height; y += step) { context.moveTo(0, y); context.lineTo(width, y); }
  context.stroke();
  note(context, `grid ${metres} m`, width - 110, height - 10);
}

// A camera as a dot, with a line along its z axis, the viewing direction.
function camera(context, frame, [x, y], [across, up], chosen) {
  const ahead = [frame.world_from_camera[across * 4 + 2], -frame.world_from_camera[up * 4 + 2]];
  context.strokeStyle = context.fillStyle = chosen ? '#ffffff' : '#22d3ee';
  context.lineWidth = chosen ? 3 : 1.5;
  context.beginPath();
  context.arc(x, y, chosen ? 6 : 3, 0, 2 * Math.PI);
  context.fill();
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(x + ahead[0] * (chosen ? 34 : 14), y + ahead[1] * (chosen ? 34 : 14));
  context.stroke();
}

function box(context, object, at, pixel, [across, up]) {
  const [left, bottom] = pixel([object.aabb_min_metres[across], object.aabb_min_metres[up]]);
  const [right, top] = pixel([object.aabb_max_metres[across], object.aabb_max_metres[up]]);
  context.strokeStyle = '#f59e0b';
  context.fillStyle = at === 0 ? '#f59e0b66' : '#f59e0b26';
  context.lineWidth = 2;
  context.fillRect(left, top, right - left, bottom - top);
  context.strokeRect(left, top, right - left, bottom - top);
  note(context, String(at + 1), left + 4, top + 17, '#ffffff');
}
