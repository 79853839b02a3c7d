// The time line: the tracked frames in order, gaps between them, and the keyframes.
//
// Each frame is as wide as any other, so that an hour between two streams takes no more room than a lost second.
import { throttled } from './page.js';
import { api, call } from './server.js';
import { $, state } from './state.js';

const REFRESH_MILLIS = 3000;
// A gap is a pause so many times as long as the usual time between two frames.
const GAP = 3;
const HEIGHT = 26;

// Times of tracked frames, seconds, in order.
let times = [];

export const refreshTimeline = throttled(async () => {
  if (!state.map || document.hidden) return;
  const { map } = state;
  // TUM text: a line for each tracked frame, which begins with its time.
  const text = await (await call(api('/trajectory'))).text();
  if (map !== state.map) return;
  times = text.split('\n').filter((line) => line && !line.startsWith('#')).map((line) => Number(line.split(' ', 1)[0])).sort((a, b) => a - b);
  drawTimeline();
}, REFRESH_MILLIS);

export function clearTimeline() {
  times = [];
  drawTimeline();
}

// Positions of frames that come after a gap.
function gaps() {
  const steps = times.slice(1).map((time, at) => time - times[at]);
  const usual = [...steps].sort((a, b) => a - b)[Math.floor(steps.length / 2)];
  return steps.flatMap((step, at) => (step > GAP * usual ? [at + 1] : []));
}

// Number of frames before a time.
function before(time) {
  let [low, high] = [0, times.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] < time) low = middle + 1;
    else high = middle;
  }
  return low;
}

export function drawTimeline() {
  const canvas = $('timeline');
  canvas.hidden = times.length < 2;
  $('timeline-text').hidden = canvas.hidden;
  if (canvas.hidden) return;
  const sharp = window.devicePixelRatio || 1;
  const width = canvas.clientWidth;
  [canvas.width, canvas.height] = [width * sharp, HEIGHT * sharp];
  const context = canvas.getContext('2d');
  context.scale(sharp, sharp);
  const color = (name) => getComputedStyle(canvas).getPropertyValue(name);
  const at = (position) => (position / times.length) * (width - 4) + 2;
  context.fillStyle = color('--good');
  context.fillRect(at(0), 10, at(times.length) - at(0), 6);
  const found = gaps();
  context.fillStyle = color('--bad');
  for (const position of found) context.fillRect(at(position) - 1.5, 7, 3, 12);
  for (const frame of state.frames) {
    const chosen = frame.sequence === state.chosen;
    context.fillStyle = color(chosen ? '--accent' : '--text');
    context.fillRect(at(before(frame.timestamp)) - (chosen ? 2 : 0.5), chosen ? 2 : 6, chosen ? 4 : 1, chosen ? 22 : 14);
  }
  const many = (count, what) => `${count.toLocaleString('en')} ${what}${count === 1 ? '' : 's'}`;
  const missing = found.length ? `, ${many(found.length, 'gap')} (nothing was sent, or the camera was lost)` : '';
  $('timeline-text').textContent = `${many(times.length, 'frame')} tracked${missing} · ${many(state.frames.length, 'keyframe')}`;
}

// The keyframe that is nearest to a click; `null` without keyframes.
export function keyframeAt(event) {
  const { left, width } = $('timeline').getBoundingClientRect();
  const wanted = ((event.clientX - left) / width) * times.length;
  const distance = (frame) => Math.abs(before(frame.timestamp) - wanted);
  return state.frames.reduce((best, frame) => (best === null || distance(frame) < distance(best) ? frame : best), null);
}
