// The dashboard: lists the maps, shows one of them live and asks it questions.
import { asked, remember } from './address.js';
import { choose, follow, refreshFrames, step } from './keyframes.js';
import { has3d } from './channels.js';
import { watchImport } from './imports.js';
import { attempt, show, throttled } from './page.js';
import { ask, forget } from './questions.js';
import { api, json } from './server.js';
import { listenForManaging } from './manage.js';
import { openSpace, refreshPath, showSpace } from './space.js';
import { refreshSplats } from './splats.js';
import { $, state } from './state.js';
import { drawStatus, refreshStatus } from './status.js';
import { listenForLogin } from './session.js';
import { clearTimeline, drawTimeline, keyframeAt, refreshTimeline } from './timeline.js';
import { drawHeat, drawPicture, drawPlanNow } from './view.js';

const LIST_MILLIS = 4000;
const PICTURE_MILLIS = 3000;
const PLAN_MILLIS = 500;

async function listMaps() {
  const { maps } = await json('v1/maps');
  const names = maps.map((map) => map.name);
  const select = $('maps');
  if (names.join() !== [...select.options].map((option) => option.value).join()) {
    select.replaceChildren(...names.map((name) => new Option(name, name)));
  }
  const none = names.length === 0;
  $('empty').hidden = !none;
  document.querySelector('main').hidden = $('live').hidden = none;
  if (!names.includes(state.map)) {
    const { map } = asked();
    open(names.includes(map) ? map : names[0] ?? null);
  }
  if (state.map && !state.settled) refreshStatus();
  select.value = state.map ?? '';
  // A map that the server was still loading has no events before.
  const loading = maps.find((map) => map.name === state.map)?.state === 'loading';
  if (state.loading && !loading && state.map) open(state.map);
  state.loading = loading;
}

// Shows a map, with the frame and the question of the address if they are of this map.
function open(name) {
  const wanted = asked();
  const isWanted = wanted.map === name;
  state.events?.close();
  forget();
  Object.assign(state, { map: name, frames: [], chosen: null, events: null, settled: false });
  for (const id of ['strip', 'status']) $(id).replaceChildren();
  for (const id of ['picture', 'plan']) $(id).getContext('2d').clearRect(0, 0, 9999, 9999);
  $('caption').textContent = '';
  clearTimeline();
  $('warnings').hidden = true;
  show(null);
  follow(!isWanted || wanted.frame === null);
  if (isWanted) {
    state.chosen = wanted.frame;
    state.question = $('text').value = wanted.question;
  }
  openSpace(wanted);
  $('maps').value = name ?? '';
  remember();
  watchImport();
  if (!name) return;
  const events = new EventSource(api('/events'));
  events.onopen = () => live(true);
  events.onerror = () => live(false);
  events.addEventListener('status', (event) => drawStatus(JSON.parse(event.data)));
  for (const kind of ['frame', 'input_warning', 'refinement']) events.addEventListener(kind, () => refreshStatus());
  events.addEventListener('revision', () => { refreshStatus(); refreshFrames(); refreshTimeline(); redraw(); refreshSplats(); refreshPath(); });
  state.events = events;
  refreshFrames();
  refreshTimeline();
  if (state.chosen !== null) choose(state.chosen);
}

// The map has changed: so has its picture.
const redraw = throttled(async () => { if (!document.hidden) await drawPicture(); }, PICTURE_MILLIS);

function live(on) {
  $('live').textContent = on ? 'live' : 'offline';
  $('live').classList.toggle('on', on);
}

$('maps').onchange = (event) => { history.replaceState(null, '', '#'); open(event.target.value); };
$('plane').onchange = drawPlanNow;
$('alpha').oninput = drawHeat;
$('follow').onchange = () => {
  follow($('follow').checked);
  if (state.follows) { forget(); refreshFrames(); }
};
$('timeline').onclick = (event) => {
  const frame = keyframeAt(event);
  if (frame) { follow(false); choose(frame.sequence); }
};
window.onresize = drawTimeline;
$('ask').onsubmit = (event) => { event.preventDefault(); ask($('text').value); };
$('channels').onclick = (event) => {
  const channel = event.target.dataset.channel;
  if (!channel) return;
  show(null);
  showChannel(channel);
  remember();
  drawPicture();
};

function showChannel(channel) {
  const buttons = [...$('channels').children];
  const known = buttons.some((button) => button.dataset.channel === channel && !button.disabled);
  state.channel = known ? channel : 'color';
  for (const button of buttons) button.setAttribute('aria-checked', String(button.dataset.channel === state.channel));
  showSpace(state.channel === '3D');
}

document.addEventListener('splats', throttled(drawPlanNow, PLAN_MILLIS));
// Another view is another answer.
document.addEventListener('chosen', () => {
  remember();
  drawTimeline();
  if (state.question) ask(state.question);
});
// Somebody changed the address.
window.onhashchange = () => {
  state.map = null;
  showChannel(asked().channel);
  attempt(listMaps);
};
document.onkeydown = (event) => {
  const typing = event.target.matches('input, select');
  if (event.key === '/' && !typing) { event.preventDefault(); $('text').focus(); }
  if (event.key === 'ArrowLeft' && !typing) step(-1);
  if (event.key === 'ArrowRight' && !typing) step(1);
};

$('in3d').disabled = !has3d();
$('no3d').hidden = has3d();
showChannel(asked().channel);
listenForLogin();
listenForManaging(open, listMaps);

let wasDown = false;
async function poll() {
  const up = await attempt(listMaps);
  if (up && wasDown) show(null);
  wasDown = !up;
  setTimeout(poll, LIST_MILLIS);
}
poll();
