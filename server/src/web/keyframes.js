// The strip of keyframes, and choosing one of them.
import { throttled } from './page.js';
import { api, json } from './server.js';
import { $, state } from './state.js';
import { clearView, drawPicture, drawPlanNow } from './view.js';

const THUMBNAIL_WIDTH = 128;
const STRIP_LENGTH = 40;
const REFRESH_MILLIS = 1500;

export const refreshFrames = throttled(async () => {
  if (!state.map) return;
  const map = state.map;
  const { frames } = await json(api('/frames'));
  if (map !== state.map) return;
  state.frames = frames;
  drawStrip();
  document.dispatchEvent(new Event('frames'));
  const newest = frames.at(-1);
  const gone = !frames.some((frame) => frame.sequence === state.chosen);
  if (newest && (gone || (state.follows && !state.question)) && newest.sequence !== state.chosen) choose(newest.sequence);
  else drawPlanNow();
}, REFRESH_MILLIS);

// Follows the newest keyframe, or stays at the chosen one.
export function follow(follows) {
  state.follows = follows;
  $('follow').checked = follows;
}

function drawStrip() {
  const strip = $('strip');
  const present = new Map([...strip.children].map((button) => [Number(button.dataset.sequence), button]));
  const wanted = state.frames.slice(-STRIP_LENGTH);
  const buttons = wanted.map((frame) => {
    const button = present.get(frame.sequence) ?? thumbnail(frame);
    button.classList.toggle('chosen', frame.sequence === state.chosen);
    button.classList.toggle('speaks', frame.has_language);
    return button;
  });
  const atEnd = strip.scrollLeft + strip.clientWidth >= strip.scrollWidth - 8;
  const same = buttons.length === strip.children.length && buttons.every((button, at) => button === strip.children[at]);
  if (!same) {
    strip.replaceChildren(...buttons);
    if (atEnd) strip.scrollLeft = strip.scrollWidth;
  }
}

function thumbnail(frame) {
  const button = document.createElement('button');
  const image = document.createElement('img');
  const label = document.createElement('span');
  button.type = 'button';
  button.tabIndex = -1;
  button.dataset.sequence = frame.sequence;
  image.loading = 'lazy';
  image.alt = `keyframe ${frame.sequence}`;
  image.src = api(`/render?frame=${frame.sequence}&channel=color&width=${THUMBNAIL_WIDTH}`);
  label.textContent = frame.sequence;
  button.append(image, label);
  button.onclick = () => { follow(false); choose(frame.sequence); };
  return button;
}

// Shows a keyframe. The event "chosen" tells that there is another one.
export function choose(sequence) {
  state.chosen = sequence;
  clearView();
  drawStrip();
  showChosen($('strip'));
  drawPicture();
  drawPlanNow();
  document.dispatchEvent(new Event('chosen'));
}

// The keyframe that shows a point of the world best: near, and in the middle of the picture.
export function bestView([x, y, z]) {
  let best = null;
  for (const frame of state.frames) {
    const pose = frame.world_from_camera;
    const offset = [x - pose[3], y - pose[7], z - pose[11]];
    const [right, down, ahead] = [0, 1, 2].map((axis) => offset[0] * pose[axis] + offset[1] * pose[4 + axis] + offset[2] * pose[8 + axis]);
    const { width, height, fx, fy, cx, cy } = frame.camera;
    const u = ((fx * right) / ahead + cx) / width - 0.5;
    const v = ((fy * down) / ahead + cy) / height - 0.5;
    if (ahead <= 0.1 || Math.abs(u) > 0.5 || Math.abs(v) > 0.5) continue;
    const cost = Math.max(ahead, 1) * (1 + 2 * Math.hypot(u, v));
    if (best === null || cost < best.cost) best = { cost, frame };
  }
  return best?.frame ?? null;
}

// Scrolls the strip alone: scrollIntoView would scroll the page, too.
function showChosen(strip) {
  const chosen = strip.querySelector('.chosen');
  if (!chosen) return;
  const left = chosen.getBoundingClientRect().left - strip.getBoundingClientRect().left + strip.scrollLeft;
  const right = left + chosen.offsetWidth;
  if (left < strip.scrollLeft) strip.scrollLeft = left;
  if (right > strip.scrollLeft + strip.clientWidth) strip.scrollLeft = right - strip.clientWidth;
}

export function step(by) {
  const at = state.frames.findIndex((frame) => frame.sequence === state.chosen);
  const next = state.frames[at + by];
  if (next) { follow(false); choose(next.sequence); }
}
