// The dashboard: lists the maps, shows one of them live and asks it questions.
import { refreshFrames, step } from './keyframes.js';
import { attempt, show } from './page.js';
import { ask } from './questions.js';
import { api, json } from './server.js';
import { $, state } from './state.js';
import { drawStatus, refreshStatus } from './status.js';
import { listenForLogin } from './session.js';
import { clearAnswer, drawHeat, drawMarks, drawPicture, drawPlanNow } from './view.js';

const LIST_MILLIS = 4000;

async function listMaps() {
  const { maps } = await json('v1/maps');
  const names = maps.map((map) => map.name);
  const select = $('maps');
  if (names.join() !== [...select.options].map((option) => option.value).join()) {
    select.replaceChildren(...names.map((name) => new Option(name, name)));
  }
  $('empty').hidden = names.length > 0;
  if (!names.includes(state.map)) open(names[0] ?? null);
  select.value = state.map ?? '';
  // A map that the server was still loading has no events before.
  const loading = maps.find((map) => map.name === state.map)?.state === 'loading';
  if (state.loading && !loading && state.map) open(state.map);
  state.loading = loading;
}

function open(name) {
  state.events?.close();
  Object.assign(state, { map: name, frames: [], chosen: null, events: null, heat: null, labels: null, objects: [] });
  for (const id of ['strip', 'status']) $(id).replaceChildren();
  for (const id of ['picture', 'heat', 'plan']) $(id).getContext('2d').clearRect(0, 0, 9999, 9999);
  $('caption').textContent = '';
  $('warnings').hidden = true;
  drawMarks(null);
  show(null);
  if (!name) return;
  const events = new EventSource(api('/events'));
  events.onopen = () => live(true);
  events.onerror = () => live(false);
  events.addEventListener('status', (event) => drawStatus(JSON.parse(event.data)));
  events.addEventListener('frame', () => refreshStatus());
  events.addEventListener('input_warning', () => refreshStatus());
  events.addEventListener('revision', () => { refreshStatus(); refreshFrames(); });
  state.events = events;
  refreshFrames();
}

function live(on) {
  $('live').textContent = on ? 'live' : 'offline';
  $('live').classList.toggle('on', on);
}

$('maps').onchange = (event) => open(event.target.value);
$('plane').onchange = drawPlanNow;
$('alpha').oninput = drawHeat;
$('follow').onchange = () => { if ($('follow').checked) { clearAnswer(); refreshFrames(); } };
$('ask').onsubmit = (event) => { event.preventDefault(); ask($('text').value); };
$('channels').onclick = (event) => {
  const channel = event.target.dataset.channel;
  if (!channel) return;
  state.channel = channel;
  for (const button of $('channels').children) button.setAttribute('aria-checked', String(button.dataset.channel === channel));
  drawPicture();
};
document.onkeydown = (event) => {
  const typing = event.target.matches('input, select');
  if (event.key === '/' && !typing) { event.preventDefault(); $('text').focus(); }
  if (event.key === 'ArrowLeft' && !typing) step(-1);
  if (event.key === 'ArrowRight' && !typing) step(1);
};

listenForLogin();

let wasDown = false;
async function poll() {
  const up = await attempt(listMaps);
  if (up && wasDown) show(null);
  wasDown = !up;
  setTimeout(poll, LIST_MILLIS);
}
poll();
