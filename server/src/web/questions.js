// Questions and their answers.
import { remember } from './address.js';
import { bestView, choose, follow } from './keyframes.js';
import { attempt, element, show } from './page.js';
import { api, array, call, json, linked } from './server.js';
import { $, state } from './state.js';
import { clearView, drawHeat, drawMarks, drawPlanNow } from './view.js';

// If less than this share has been seen, "absent" only means "not seen".
const UNSEEN_COVERAGE = 0.05;

// What to ask, where no answer is shown.
const HINT = 'Ask for one thing: “coffee cup”, “something to sit on”. Or compare several: “chair, table, floor”.';

const post = (body) => json(api('/query'), { method: 'POST', headers: { 'content-type': 'application/json' }, body: JSON.stringify(body) });

// A comma between texts, which is not in quotes.
const COMMA = /,(?=(?:[^"“”]*["“”][^"“”]*["“”])*[^"“”]*$)/;

// Asks a question. Several texts, separated by commas, are compared with each other.
export async function ask(text) {
  const number = ++state.asked;
  const { map } = state;
  const texts = [...new Set(text.split(COMMA).map((word) => word.trim()).filter(Boolean))];
  if (!map) return;
  if (texts.length === 0) { forget(); return; }
  state.question = text;
  remember();
  $('ask').classList.add('busy');
  show(null);
  const answered = await attempt(() => (texts.length > 1 ? segment(texts, number) : locate(texts[0], number)));
  if (number !== state.asked) return;
  $('ask').classList.remove('busy');
  if (!answered) clear();
}

// Removes the question and its answer.
export function forget() {
  state.asked += 1;
  state.question = '';
  $('text').value = '';
  $('ask').classList.remove('busy');
  clear();
  remember();
}

// Removes the answer.
function clear() {
  tell(null, []);
  $('answer').replaceChildren(element('p', HINT, 'quiet'));
  clearView();
  drawObjects();
  drawPlanNow();
}

// Keeps an answer about the whole map, and tells the 3D view.
function tell(answer, objects) {
  Object.assign(state, { answer, objects });
  for (const event of ['answered', 'objects']) document.dispatchEvent(new Event(event));
}

async function segment(texts, number) {
  const { map, chosen } = state;
  const in3d = post({ texts });
  const inView = chosen === null ? null : post({ texts, view: { frame: chosen } });
  const [space, view] = await Promise.all([in3d, inView]);
  const labels = view ? await createImageBitmap(await (await call(linked(view.labels.url))).blob()) : null;
  if (number !== state.asked || map !== state.map) return;
  tell({ space, legend: space.legend }, []);
  drawLegend(space, view, chosen);
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
  const heat = view?.heatmap ? await array(linked(view.heatmap.url)) : null;
  if (number !== state.asked || map !== state.map) return;
  tell({ space, legend: null }, space.objects ?? []);
  drawAnswer(space, view, chosen);
  drawObjects();
  drawPlanNow();
  if (chosen === state.chosen) {
    state.heat = heat;
    state.labels = null;
    drawHeat();
    drawMarks(view);
  }
}

function meter(label, share) {
  const bar = element('div', '', 'meter');
  const fill = document.createElement('i');
  fill.style.width = `${Math.round(100 * share)}%`;
  bar.append(fill);
  return [element('p', `${label} ${(100 * share).toFixed(0)} %`, 'quiet'), bar];
}

// How the text was understood: "red chair · next to window". Empty if it is a name.
function understood({ text, understood: { object, attributes = [], relation, others = [] } }) {
  if (object === text) return '';
  const thing = [...attributes, object].join(' ');
  return relation ? `${thing} · ${relation} ${others.join(' and ')}` : thing;
}

// What the view shows of it.
function inView(view) {
  if (!view.present) return `not here (${percent(view.confidence)} sure that it is)`;
  const regions = `${view.boxes.length} region${view.boxes.length === 1 ? '' : 's'}`;
  return view.peak ? `${regions}, best ${view.peak.score.toFixed(2)} at ${Math.round(view.peak.x)}, ${Math.round(view.peak.y)}` : regions;
}

function percent(share) {
  return `${(100 * share).toFixed(share < 0.1 ? 1 : 0)} %`;
}

// What the answer was computed from, and how long that took.
function spent(space, view) {
  const millis = (answer) => `${answer.timing_ms.total.toFixed(0)} ms`;
  return element('p', `3D ${millis(space)}${view ? ` · view ${millis(view)}` : ''} · revision ${space.revision}${space.settled ? '' : ', not settled yet'}`, 'quiet');
}

function drawAnswer(space, view, frame) {
  const verdict = element('p', `“${space.text}” `, 'verdict');
  const unseen = !space.present && space.coverage < UNSEEN_COVERAGE;
  if (unseen) verdict.append(element('span', 'may be there: hardly anything has been seen yet', 'quiet'));
  else if (!space.present && view?.present) verdict.append(element('span', 'is in this view', 'yes'));
  else verdict.append(element('span', space.present ? 'is there' : 'is not there', space.present ? 'yes' : 'no'));
  const lines = [verdict];
  const read = understood(space);
  if (read) lines.push(element('p', `understood: ${read}`, 'quiet'));
  // What depends on where one looks from is decided in the view only.
  const reason = view ? view.reason : space.reason;
  if (reason) lines.push(element('p', reason));
  lines.push(...meter('confidence', space.confidence), ...meter('seen with language', space.coverage));
  if (view) lines.push(element('p', `frame ${frame}: ${inView(view)}`));
  lines.push(spent(space, view));
  $('answer').replaceChildren(...lines);
}

function drawLegend(space, view, frame) {
  const rows = space.legend.map((entry, at) => {
    const row = element('p', '', 'legend');
    const swatch = document.createElement('i');
    swatch.style.background = entry.color;
    const here = view ? `${percent(view.legend[at].share)} of this view · ` : '';
    row.append(swatch, element('b', entry.text), element('span', `${here}${percent(entry.share)} of the map`, 'quiet'));
    return row;
  });
  if (view) rows.push(element('p', `shares of frame ${frame} and of the map`, 'quiet'));
  rows.push(spent(space, view));
  $('answer').replaceChildren(...rows);
}

function drawObjects() {
  const numbers = (list) => list.map((value) => value.toFixed(2)).join(' ');
  const rows = state.objects.map((object, at) => {
    const row = document.createElement('tr');
    const cells = [at + 1, object.score.toFixed(2), `${(100 * object.confidence).toFixed(0)} %`, numbers(object.center_metres), numbers(object.size_metres), object.points];
    row.append(...cells.map((cell) => element('td', cell)));
    row.lastChild.className = 'wide';
    row.tabIndex = 0;
    row.title = 'show the view that sees it best';
    row.onclick = () => see(object);
    row.onkeydown = (event) => { if (event.key === 'Enter') see(object); };
    return row;
  });
  if (rows.length === 0) {
    const cell = element('td', nothing(), 'quiet');
    cell.colSpan = 6;
    rows.push(document.createElement('tr'));
    rows[0].append(cell);
  }
  $('objects').replaceChildren(...rows);
}

// Why no object is listed.
function nothing() {
  if (!state.answer) return 'none yet';
  return state.answer.legend ? 'ask for one thing to find its objects' : 'nothing found';
}

function see(object) {
  const frame = bestView(object.center_metres);
  if (!frame) { show(new Error('no keyframe sees this object')); return; }
  follow(false);
  choose(frame.sequence);
}
