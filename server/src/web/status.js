// The status of the map.
import { element, throttled } from './page.js';
import { api, json } from './server.js';
import { turnUpright } from './space.js';
import { $, state } from './state.js';

const REFRESH_MILLIS = 1500;

export const refreshStatus = throttled(async () => { if (state.map) drawStatus(await json(api())); }, REFRESH_MILLIS);

export function drawStatus(status) {
  state.settled = status.settled;
  turnUpright(status.up?.direction);
  const chip = (label, value, kind = '') => {
    const item = document.createElement('li');
    const number = document.createElement('b');
    number.textContent = value;
    item.append(`${label} `, number);
    item.className = kind;
    return item;
  };
  const count = (value) => value.toLocaleString('en');
  const chips = [
    chip('camera', status.tracking_state, status.tracking_state === 'lost' ? 'bad' : 'good'),
    chip('frames', `${count(status.frames_tracked)} / ${count(status.frames_received)}`),
    chip('keyframes', count(status.keyframes)),
    chip('gaussians', count(status.gaussians)),
    chip('queue', `${status.queue_depth} / ${status.queue_capacity}`),
    chip('revision', count(status.revision)),
    chip('memory', `${((status.gpu_bytes + status.keyframe_bytes) / 2 ** 20).toFixed(0)} MiB`),
    chip('mapper', mapper(status)),
  ];
  if (status.frames_refused) chips.push(chip('refused', count(status.frames_refused), 'bad'));
  if (status.failure) chips.push(chip('failed', status.failure, 'bad'));
  $('status').replaceChildren(...chips);
  drawWarnings(status.input_warnings ?? []);
}

// What the mapper does.
function mapper({ settled, refinement }) {
  if (!settled) return 'working';
  return ['refining', 'converged'].includes(refinement) ? refinement : 'settled';
}

// What is probably wrong with the frames that were sent.
function drawWarnings(warnings) {
  const rows = warnings.map(({ problem, message }) => {
    const row = document.createElement('li');
    row.append(element('b', problem.replaceAll('_', ' ')), message);
    return row;
  });
  $('warnings').replaceChildren(...rows);
  $('warnings').hidden = rows.length === 0;
}
