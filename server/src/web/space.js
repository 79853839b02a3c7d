// The 3D view: splats, path, keyframes and objects, and the ways to move among them.
import { remember } from './address.js';
import { choose, follow } from './keyframes.js';
import { Measure } from './measure.js';
import { Motion, ahead, towards } from './motion.js';
import { attempt, element, show, throttled } from './page.js';
import { hit } from './pick.js';
import { openSplats, resizeSplats, splats } from './splats.js';
import { api, call } from './server.js';
import { $, state } from './state.js';
import { roomOf } from './room.js';

const EYE_METRES = 1.6;
const PATH_MILLIS = 4000;
// From above the ceiling, rooms are shown up to this share of their height.
const LOWER_PART = 0.75;
// How near to a keyframe or an object a click must be, pixels.
const NEAR_PIXELS = 18;
const [PATH, FRAME, CHOSEN, OBJECT] = ['#22d3ee', '#22d3ee', '#ffffff', '#f59e0b'];

let view = null;
let begun = null;
let edgesOf = null;
// Whether the camera of this map has its place.
let isPlaced = false;
let up = null;
// Places of the camera on its path.
let path = [];

const motion = new Motion(() => {
  if (!view) return;
  view.look(motion);
  cutAway();
  rememberSoon();
});
const measure = new Measure({ draw: (...lines) => view.draw('measure', ...lines), hit: (origin, direction) => hitBy(origin, direction) });

const canvas = () => $('scene');
const strength = () => Number($('alpha').value);

// Shows or hides the view; loads its renderer when it is shown first.
export function showSpace(on) {
  $('space').hidden = !on;
  for (const id of ['picture', 'heat', 'marks', 'caption']) $(id).classList.toggle('away', on);
  resizeSplats();
  if (!on) { endMeasure(); return; }
  begun ??= begin();
  if (view) { view.resize(); drawAll(); document.dispatchEvent(new Event('answered')); }
}

async function begin() {
  $('loading').hidden = false;
  const loaded = await attempt(async () => {
    const { View, edges } = await import('./scene.js');
    edgesOf = edges;
    view = new View(canvas(), drawTags);
  });
  if (!loaded) { $('loading').textContent = 'The 3D view cannot be shown here: choose another.'; return; }
  canvas().addEventListener('webglcontextlost', () => show(new Error('the browser gave up the 3D view: load the page again')));
  if (up) view.setUp(up);
  new ResizeObserver(() => view.resize()).observe(canvas());
  motion.listen(canvas(), clicked);
  view.resize();
  document.dispatchEvent(new Event('splats'));
  document.dispatchEvent(new Event('answered'));
  drawAll();
}

// Another map.
export function openSpace({ camera, map }) {
  endMeasure();
  Object.assign(motion, { height: null });
  isPlaced = false;
  up = null;
  path = [];
  for (const name of ['path', 'frames', 'objects']) view?.draw(name, [], []);
  state.camera = map === state.map ? camera : null;
  openSplats();
}

// The map has a direction up.
export function turnUpright(direction) {
  if (!direction || String(direction) === String(up)) return;
  up = direction;
  if (!view) return;
  const turn = view.setUp(direction);
  if (!isPlaced) { place(); return; }
  // The camera stays where it was in the map.
  const looks = turn(ahead(motion));
  motion.go({ eye: turn(motion.eye), ...towards(looks) });
}

export const refreshPath = throttled(async () => {
  const { map } = state;
  if (!map || $('space').hidden || document.hidden) return;
  const text = await (await call(api('/trajectory'))).text();
  if (map !== state.map) return;
  path = text.split('\n').filter((line) => line && !line.startsWith('#')).map((line) => line.split(' ').slice(1, 4).map(Number));
  drawPath();
}, PATH_MILLIS);

document.addEventListener('splats', () => {
  if (!view) return;
  const all = splats();
  view.update(strength());
  $('loading').hidden = all.count > 0;
  $('loading').textContent = all.map ? 'nothing has been mapped yet' : 'loading the splats …';
  $('counted').textContent = all.count ? `${all.count.toLocaleString('en')}${all.count < all.total ? ` of ${all.total.toLocaleString('en')}` : ''} splats` : '';
  if (all.count && up && all.count === all.total) motion.height = eyeHeight();
  place();
});
document.addEventListener('scores', () => view?.recolor(strength()));
document.addEventListener('objects', () => drawObjects());
document.addEventListener('frames', () => { place(); drawFrames(); });
document.addEventListener('chosen', () => {
  drawFrames();
  if (isPlaced && !state.follows && !$('space').hidden && state.chosen !== null) standAt(state.chosen);
});
$('alpha').addEventListener('input', () => { if (!$('space').hidden) view?.recolor(strength()); });

// Puts the camera of a new map where the address says, or at home.
function place() {
  if (isPlaced || !view || !up || splats().count === 0 || state.frames.length === 0) return;
  isPlaced = true;
  motion.height ??= eyeHeight();
  if (state.camera) motion.go(state.camera);
  else home(false);
  showMode();
}

// Height of the eye of somebody who stands on the floor, as far as the room has one.
function eyeHeight() {
  const { floor, ceiling } = roomOf(splats(), up);
  const own = state.frames.map((frame) => view.toUp([3, 7, 11].map((at) => frame.world_from_camera[at]))[1]);
  const middle = own.sort((a, b) => a - b)[own.length >> 1] ?? floor + EYE_METRES;
  return ceiling - floor > EYE_METRES + 0.2 ? floor + EYE_METRES : middle;
}

const hitBy = (origin, direction) => hit(splats(), origin, direction, (at) => view.isCut(view.of, at));

// Takes the ceiling away for who is above it.
function cutAway() {
  if (!isPlaced || splats().count === 0) return;
  const { floor, ceiling } = roomOf(splats(), up);
  view.setCut(motion.eye[1] > ceiling ? floor + LOWER_PART * (ceiling - floor) : null);
}

// Pose of the camera at a keyframe.
function poseAt(frame) {
  const pose = frame.world_from_camera;
  const column = (at) => [pose[at], pose[4 + at], pose[8 + at]];
  const [place, direction] = [column(3), column(2)];
  const distance = hitBy(place, direction) ?? 2;
  return { eye: view.toUp(place), ...towards(view.toUp(direction)), distance };
}

function standAt(sequence) {
  const frame = state.frames.find((each) => each.sequence === sequence);
  if (frame) motion.go(poseAt(frame), true);
}

// A little behind the keyframe with the farthest view.
function home(smoothly) {
  let best = null;
  const some = state.frames.filter((_, at) => at % Math.ceil(state.frames.length / 12) === 0);
  for (const frame of some) {
    const pose = poseAt(frame);
    if (!best || pose.distance > best.distance) best = pose;
  }
  if (!best) return;
  const back = 0.12 * best.distance;
  const eye = best.eye.map((value, at) => value - back * ahead(best)[at]);
  motion.go({ mode: motion.mode, ...best, eye, distance: best.distance + back }, smoothly);
}

// The whole map, from above.
function fromAbove() {
  const { center, size, ceiling } = roomOf(splats(), up);
  const pose = { yaw: motion.yaw, pitch: -1.05, distance: 1.1 * size };
  const eye = view.toUp(center).map((value, at) => value - pose.distance * ahead(pose)[at]);
  motion.go({ ...pose, mode: 'orbit', eye: [eye[0], Math.max(eye[1], ceiling + 0.1), eye[2]] }, true);
}

function drawAll() {
  drawFrames();
  drawObjects();
  refreshPath();
}

function drawPath() {
  if (!view) return;
  const pairs = path.slice(1).flatMap((place, at) => [path[at], place]);
  view.draw('path', pairs, pairs.slice(pairs.length / 2).map(() => PATH), 2);
}

// Length of a keyframe's pyramid: less where they are near each other.
function pyramid() {
  const places = state.frames.map((frame) => [3, 7, 11].map((at) => frame.world_from_camera[at]));
  const steps = places.slice(1).map((place, at) => Math.hypot(...place.map((value, axis) => value - places[at][axis]))).sort((a, b) => a - b);
  return Math.min(0.14, Math.max(0.05, 0.5 * (steps[steps.length >> 1] ?? 1)));
}

// Keyframes as pyramids: the tip is the camera, the base is what it sees.
function drawFrames() {
  if (!view || $('space').hidden) return;
  const depth = pyramid();
  const [points, colors] = [[], []];
  const eye = isPlaced ? view.toMap(motion.eye) : null;
  for (const { world_from_camera: pose, camera: { width, height, fx, fy, cx, cy }, sequence } of state.frames) {
    // Nobody looks through the lines of a camera near them.
    if (eye && Math.hypot(eye[0] - pose[3], eye[1] - pose[7], eye[2] - pose[11]) < 5 * depth) continue;
    const place = (u, v, d) => [0, 1, 2].map((row) => pose[row * 4] * ((u - cx) / fx) * d + pose[row * 4 + 1] * ((v - cy) / fy) * d + pose[row * 4 + 2] * d + pose[row * 4 + 3]);
    const tip = place(cx, cy, 0);
    const corners = [[0, 0], [width, 0], [width, height], [0, height]].map(([u, v]) => place(u, v, depth));
    corners.forEach((corner, at) => {
      points.push(tip, corner, corner, corners[(at + 1) % 4]);
      const color = sequence === state.chosen ? CHOSEN : FRAME;
      colors.push(color, color);
    });
  }
  view.draw('frames', points, colors, 1.5);
}

function drawObjects() {
  if (!view) return;
  const points = state.objects.flatMap((object) => edgesOf(object));
  view.draw('objects', points, points.slice(points.length / 2).map(() => OBJECT), 2.5);
  $('tags').replaceChildren(...state.objects.map((object, at) => element('span', `${at + 1} ${state.answer?.space.understood?.object ?? ''}`, 'tag')), ...measure.tags);
  drawTags();
}

// Names stay where the things are.
function drawTags() {
  const put = (tag, point) => {
    const pixel = point && view.project(point);
    tag.hidden = !pixel;
    if (pixel) tag.style.transform = `translate(${pixel[0].toFixed(1)}px, ${pixel[1].toFixed(1)}px) translate(-50%, -100%)`;
  };
  const tags = [...$('tags').children];
  state.objects.forEach((object, at) => {
    const corners = edgesOf(object).map((corner) => view.toUp(corner)[1]);
    const above = view.toMap([0, 0.5 * (Math.max(...corners) - Math.min(...corners)) + 0.03, 0]);
    if (tags[at]) put(tags[at], object.center_metres.map((value, axis) => value + above[axis]));
  });
  measure.tags.forEach((tag) => put(tag, measure.middle()));
}

// Pixel of a keyframe's pyramid; null behind the camera.
export function pixelOf({ world_from_camera: pose }) {
  return view.project([0, 1, 2].map((row) => pose[row * 4 + 3] + 0.06 * pose[row * 4 + 2]));
}

// A click measures, or chooses a keyframe.
function clicked(x, y) {
  if (measure.isOn) {
    const { origin, direction } = view.ray(x, y);
    measure.add(origin, direction);
    drawObjects();
    return;
  }
  let best = null;
  for (const frame of state.frames) {
    const pixel = pixelOf(frame);
    const off = pixel ? Math.hypot(pixel[0] - x, pixel[1] - y) : Infinity;
    if (off < NEAR_PIXELS && (!best || off < best.off)) best = { off, frame };
  }
  if (best) { follow(false); choose(best.frame.sequence); }
}

let soon = null;
// When the camera rests: the address.
function rememberSoon() {
  if (!isPlaced) return;
  clearTimeout(soon);
  soon = setTimeout(() => { state.camera = motion.pose(); remember(); drawFrames(); }, 400);
}

function showMode() {
  for (const button of $('modes').children) button.setAttribute('aria-checked', String(button.dataset.mode === motion.mode));
  $('pad').hidden = motion.mode === 'orbit';
}

function endMeasure() {
  measure.end();
  if (view) drawObjects();
  showMeasure();
}

function showMeasure() {
  $('measure').setAttribute('aria-pressed', String(measure.isOn));
  $('space').classList.toggle('measures', measure.isOn);
  $('hint').textContent = measure.isOn ? 'choose two points · Escape or the button ends' : '';
}

$('modes').onclick = (event) => {
  const { mode } = event.target.dataset;
  if (!mode) return;
  motion.setMode(mode);
  showMode();
};
$('home').onclick = () => { if (view) home(true); };
$('above').onclick = () => { if (isPlaced) { fromAbove(); motion.mode = 'orbit'; showMode(); } };
$('measure').onclick = () => {
  if (measure.isOn || !view) { endMeasure(); return; }
  measure.begin();
  showMeasure();
  canvas().focus();
};
$('space').addEventListener('keydown', (event) => {
  if (!measure.isOn) return;
  if (event.key === 'Escape') endMeasure();
  // Without a pointer: the middle of the view.
  if (event.key === 'Enter' && event.target === canvas()) clicked(canvas().clientWidth / 2, canvas().clientHeight / 2);
});
for (const button of $('pad').children) {
  const hold = (on) => () => motion.hold(button.dataset.move, on);
  button.onpointerdown = hold(true);
  for (const end of ['onpointerup', 'onpointerleave', 'onpointercancel', 'onblur', 'onkeyup']) button[end] = hold(false);
  button.onkeydown = (event) => { if (event.key === 'Enter' || event.key === ' ') motion.hold(button.dataset.move, true); };
}
