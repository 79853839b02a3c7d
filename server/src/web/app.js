// The dashboard: lists maps, shows one live, asks it questions and draws the answers.
import { drawPlan } from '/dashboard/plan.js';

const PICTURE_WIDTH = 640;
const THUMBNAIL_WIDTH = 128;
const STRIP_LENGTH = 40;
const LIST_MILLIS = 4000;
const REFRESH_MILLIS = 1500;
// Below this, "absent" only means "not seen".
const UNSEEN_COVERAGE = 0.05;

const $ = (id) => document.getElementById(id);
const state = { map: null, frames: [], chosen: null, channel: 'color', events: null, heat: null, labels: null, objects: [], asked: 0 };

// ---- talking to the server -------------------------------------------------------------------

async function call(path, options = {}) {
  let response;
  try {
    response = await fetch(path, { cache: 'no-store', ...options });
  } catch {
    throw new Error('the server does not answer');
  }
  if (!response.ok) {
    const problem = await response.json().catch(() => ({}));
    throw new Error(problem.detail ?? `${response.status} ${response.statusText}`);
  }
  return response;
}

const api = (rest = '') => `/v1/maps/${encodeURIComponent(state.map)}${rest}`;
const json = async (path, options) => (await call(path, options)).json();

// A float32 .npy, version 1: {shape, values}.
async function array(path) {
  const response = await call(path, { headers: { accept: 'application/x-npy' } });
  const buffer = await response.arrayBuffer();
  const length = new DataView(buffer).getUint16(8, true);
  const header = new TextDecoder().decode(new Uint8Array(buffer, 10, length));
  const shape = header.match(/'shape': \(([^)]*)\)/)[1].split(',').map((s) => s.trim()).filter(Boolean).map(Number);
  return { shape, values: new Float32Array(buffer.slice(10 + length)) };
}

function show(error) {
  $('error').textContent = error ? error.message : '';
  $('error').hidden = !error;
}

// Runs a step and shows what goes wrong; nothing is thrown further.
async function attempt(step) {
  try {
    await step();
    return true;
  } catch (error) {
    show(error);
    return false;
  }
}

// At most once per interval, and once more at its end if it was asked for meanwhile.
function throttled(work, millis) {
  let waiting = false;
  let again = false;
  return async function run() {
    if (waiting) { again = true; return; }
    waiting = true;
    await attempt(work);
    setTimeout(() => { waiting = false; if (again) { again = false; run(); } }, millis);
  };
}

// ---- maps and their state --------------------------------------------------------------------

async function listMaps() {
  const { maps } = await json('/v1/maps');
  const names = maps.map((map) => map.name);
  const select = $('maps');
  if (names.join() !== [...select.options].map((option) => option.value).join()) {
    select.replaceChildren(...names.map((name) => new Option(name, name)));
  }
  $('empty').hidden = names.length > 0;
  if (!names.includes(state.map)) open(names[0] ?? null);
  select.value = state.map ?? '';
}

function open(name) {
  state.events?.close();
  Object.assign(state, { map: name, frames: [], chosen: null, events: null, heat: null, labels: null, objects: [] });
  for (const id of ['strip', 'status']) $(id).replaceChildren();
  for (const id of ['picture', 'heat', 'plan']) $(id).getContext('2d').clearRect(0, 0, 9999, 9999);
  $('caption').textContent = '';
  drawMarks(null);
  show(null);
  if (!name) return;
  const events = new EventSource(api('/events'));
  events.onopen = () => live(true);
  events.onerror = () => live(false);
  events.addEventListener('status', (event) => drawStatus(JSON.parse(event.data)));
  events.addEventListener('frame', () => refreshStatus());
  events.addEventListener('revision', () => { refreshStatus(); refreshFrames(); });
  state.events = events;
  refreshFrames();
}

function live(on) {
  $('live').textContent = on ? 'live' : 'offline';
  $('live').classList.toggle('on', on);
}

const refreshStatus = throttled(async () => { if (state.map) drawStatus(await json(api())); }, REFRESH_MILLIS);

function drawStatus(status) {
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
    chip('tracking', status.tracking_state, status.tracking_state === 'lost' ? 'bad' : 'good'),
    chip('frames', `${count(status.frames_tracked)} / ${count(status.frames_received)}`),
    chip('keyframes', count(status.keyframes)),
    chip('gaussians', count(status.gaussians)),
    chip('queue', `${status.queue_depth} / ${status.queue_capacity}`),
    chip('revision', count(status.revision)),
    chip('memory', `${((status.gpu_bytes + status.keyframe_bytes) / 2 ** 20).toFixed(0)} MiB`),
    chip('mapper', status.settled ? 'settled' : 'working'),
  ];
  if (status.frames_refused) chips.push(chip('refused', count(status.frames_refused), 'bad'));
  if (status.failure) chips.push(chip('failed', status.failure, 'bad'));
  $('status').replaceChildren(...chips);
}

// ---- keyframes -------------------------------------------------------------------------------

const refreshFrames = throttled(async () => {
  if (!state.map) return;
  const map = state.map;
  const { frames } = await json(api('/frames'));
  if (map !== state.map) return;
  state.frames = frames;
  drawStrip();
  const newest = frames.at(-1);
  const gone = !frames.some((frame) => frame.sequence === state.chosen);
  if (newest && (gone || ($('follow').checked && !state.heat && !state.labels))) {
    if (newest.sequence !== state.chosen) choose(newest.sequence);
  }
  drawPlanNow();
}, REFRESH_MILLIS);

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
  button.onclick = () => { $('follow').checked = false; choose(frame.sequence); };
  return button;
}

function choose(sequence) {
  state.chosen = sequence;
  clearAnswer();
  drawStrip();
  $('strip').querySelector('.chosen')?.scrollIntoView({ block: 'nearest', inline: 'nearest' });
  drawPicture();
  drawPlanNow();
}

function step(by) {
  const at = state.frames.findIndex((frame) => frame.sequence === state.chosen);
  const next = state.frames[at + by];
  if (next) { $('follow').checked = false; choose(next.sequence); }
}

// ---- the picture -----------------------------------------------------------------------------

async function drawPicture() {
  const { map, chosen, channel } = state;
  if (chosen === null) return;
  const path = api(`/render?frame=${chosen}&channel=${channel}&width=${PICTURE_WIDTH}`);
  const still = () => map === state.map && chosen === state.chosen && channel === state.channel;
  await attempt(async () => {
    const image = channel === 'depth' ? depthImage(await array(path)) : await createImageBitmap(await (await call(path)).blob());
    if (!still()) return;
    const canvas = $('picture');
    canvas.width = image.width;
    canvas.height = image.height;
    const context = canvas.getContext('2d');
    if (image instanceof ImageData) context.putImageData(image, 0, 0);
    else context.drawImage(image, 0, 0);
    $('caption').textContent = `frame ${chosen} · ${channel}`;
  });
}

// Near is bright; nothing is black.
function depthImage({ shape: [height, width], values }) {
  const image = new ImageData(width, height);
  let far = 0;
  for (const metres of values) if (metres > far) far = metres;
  values.forEach((metres, at) => {
    const shade = metres > 0 ? 255 * (1 - 0.9 * (metres / far)) : 0;
    image.data.set([shade * 0.75, shade * 0.95, shade, 255], at * 4);
  });
  return image;
}

// ---- questions -------------------------------------------------------------------------------

const post = (body) => json(api('/query'), { method: 'POST', headers: { 'content-type': 'application/json' }, body: JSON.stringify(body) });

// Several words with commas between them share the view among them.
async function ask(text) {
  const number = ++state.asked;
  const { map, chosen } = state;
  const texts = [...new Set(text.split(',').map((word) => word.trim()).filter(Boolean))];
  if (!map || texts.length === 0) return;
  $('ask').classList.add('busy');
  show(null);
  await attempt(() => (texts.length > 1 ? segment(texts, number) : locate(texts[0], number)));
  if (number === state.asked) $('ask').classList.remove('busy');
}

async function segment(texts, number) {
  const { map, chosen } = state;
  const in3d = post({ texts });
  const inView = chosen === null ? null : post({ texts, view: { frame: chosen } });
  const [space, view] = await Promise.all([in3d, inView]);
  const labels = view ? await createImageBitmap(await (await call(view.labels.url)).blob()) : null;
  if (number !== state.asked || map !== state.map) return;
  state.objects = [];
  drawLegend(space, view);
  drawObjects();
  drawPlanNow();
  if (chosen === state.chosen) {
    state.heat = null;
    state.labels = labels;
    drawHeat();
    drawMarks(null);
  }
}

async function locate(text, number) {
  const { map, chosen } = state;
  const in3d = post({ text, outputs: ['objects'] });
  const inView = chosen === null ? null : post({ text, view: { frame: chosen }, outputs: ['heatmap', 'boxes'] });
  const [space, view] = await Promise.all([in3d, inView]);
  const heat = view?.heatmap ? await array(view.heatmap.url) : null;
  if (number !== state.asked || map !== state.map) return;
  state.objects = space.objects ?? [];
  drawAnswer(space, view);
  drawObjects();
  drawPlanNow();
  if (chosen === state.chosen) {
    state.heat = heat;
    state.labels = null;
    drawHeat();
    drawMarks(view);
  }
}

function clearAnswer() {
  state.heat = null;
  state.labels = null;
  drawHeat();
  drawMarks(null);
}

function element(tag, text, kind = '') {
  const made = document.createElement(tag);
  made.textContent = text;
  made.className = kind;
  return made;
}

function meter(label, share) {
  const bar = element('div', '', 'meter');
  const fill = document.createElement('i');
  fill.style.width = `${Math.round(100 * share)}%`;
  bar.append(fill);
  return [element('p', `${label} ${(100 * share).toFixed(0)} %`, 'quiet'), bar];
}

function drawAnswer(space, view) {
  const verdict = element('p', `“${space.text}” `, 'verdict');
  const unseen = !space.present && space.coverage < UNSEEN_COVERAGE;
  if (unseen) verdict.append(element('span', 'may be there: hardly anything has been seen yet', 'quiet'));
  else verdict.append(element('span', space.present ? 'is there' : 'is not there', space.present ? 'yes' : 'no'));
  const lines = [verdict, ...meter('confidence', space.confidence), ...meter('seen with language', space.coverage)];
  if (view) {
    const where = view.present ? `${view.boxes.length} region${view.boxes.length === 1 ? '' : 's'} in this view` : 'not in this view';
    const peak = view.peak ? `, best ${view.peak.score.toFixed(2)} at ${Math.round(view.peak.x)}, ${Math.round(view.peak.y)}` : '';
    lines.push(element('p', where + peak));
  }
  const spent = (answer) => `${answer.timing_ms.total.toFixed(0)} ms`;
  lines.push(element('p', `3D ${spent(space)}${view ? ` · view ${spent(view)}` : ''} · revision ${space.revision}`, 'quiet'));
  $('answer').replaceChildren(...lines);
}

function drawLegend(space, view) {
  const percent = (share) => `${(100 * share).toFixed(share < 0.1 ? 1 : 0)} %`;
  const rows = space.legend.map((entry, at) => {
    const row = element('p', '', 'legend');
    const swatch = document.createElement('i');
    swatch.style.background = entry.color;
    const here = view ? `${percent(view.legend[at].share)} of this view · ` : '';
    row.append(swatch, element('b', entry.text), element('span', `${here}${percent(entry.share)} of the map`, 'quiet'));
    return row;
  });
  const spent = (answer) => `${answer.timing_ms.total.toFixed(0)} ms`;
  rows.push(element('p', `3D ${spent(space)}${view ? ` · view ${spent(view)}` : ''} · revision ${space.revision}`, 'quiet'));
  $('answer').replaceChildren(...rows);
}

function drawObjects() {
  const numbers = (list) => list.map((value) => value.toFixed(2)).join(' ');
  const rows = state.objects.map((object, at) => {
    const row = document.createElement('tr');
    const cells = [at + 1, object.score.toFixed(2), numbers(object.center), numbers(object.size), object.points];
    row.append(...cells.map((cell) => element('td', cell)));
    return row;
  });
  if (rows.length === 0) {
    const cell = element('td', 'nothing found', 'quiet');
    cell.colSpan = 5;
    rows.push(document.createElement('tr'));
    rows[0].append(cell);
  }
  $('objects').replaceChildren(...rows);
}

// Transparent below half the relevancy (neither more nor less like the words than anything else).
function drawHeat() {
  const canvas = $('heat');
  const context = canvas.getContext('2d');
  context.clearRect(0, 0, canvas.width, canvas.height);
  if (state.labels) {
    [canvas.width, canvas.height] = [state.labels.width, state.labels.height];
    context.globalAlpha = Number($('alpha').value);
    context.drawImage(state.labels, 0, 0);
    context.globalAlpha = 1;
    return;
  }
  if (!state.heat) return;
  const { shape: [height, width], values } = state.heat;
  const strength = Number($('alpha').value);
  const image = new ImageData(width, height);
  values.forEach((value, at) => {
    const t = Math.min(1, Math.max(0, (value - 0.4) / 0.5));
    image.data.set([255 * Math.min(1, 2 * t), 255 * (t < 0.5 ? 1.2 * t + 0.2 : 1.6 * (1 - t)), 255 * Math.max(0, 0.7 - 1.4 * t), 255 * strength * Math.sqrt(t)], at * 4);
  });
  canvas.width = width;
  canvas.height = height;
  context.putImageData(image, 0, 0);
}

function drawMarks(view) {
  const svg = $('marks');
  svg.replaceChildren();
  if (!view?.heatmap) return;
  svg.setAttribute('viewBox', `0 0 ${view.heatmap.width} ${view.heatmap.height}`);
  svg.setAttribute('preserveAspectRatio', 'none');
  const add = (name, attributes) => {
    const mark = document.createElementNS('http://www.w3.org/2000/svg', name);
    for (const [key, value] of Object.entries(attributes)) mark.setAttribute(key, value);
    svg.append(mark);
  };
  (view.boxes ?? []).forEach(({ x, y, width, height }, at) => add('rect', { x, y, width, height, rx: 2, class: at === 0 ? 'first' : '' }));
  if (view.present && view.peak) add('circle', { cx: view.peak.x, cy: view.peak.y, r: view.heatmap.width / 80 });
}

function drawPlanNow() {
  drawPlan($('plan'), state.frames, state.objects, $('plane').value, state.chosen);
}

// ---- the page --------------------------------------------------------------------------------

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

let wasDown = false;
async function poll() {
  const up = await attempt(listMaps);
  if (up && wasDown) show(null);
  wasDown = !up;
  setTimeout(poll, LIST_MILLIS);
}
poll();
