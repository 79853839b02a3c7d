// Recordings that are uploaded: sending one, and how far it is mapped.
import { attempt, element } from './page.js';
import { api, call, send } from './server.js';
import { $, state } from './state.js';

const REFRESH_MILLIS = 1000;
const ENDED = { done: 'The recording is mapped', failed: 'The recording was not mapped to its end', stopped: 'The recording was stopped' };

let timer = null;
// Name of the map whose import this page sent or saw running: only then is its end worth telling.
let seen = null;

// `open` shows a map; `change` runs a step of the dialog and shows its error; it returns whether it succeeded.
export function listenForImports(open, change) {
  $('import').onsubmit = async (event) => {
    event.preventDefault();
    const [file] = $('import-file').files;
    const name = $('import-name').value.trim();
    const poses = $('import-poses').value;
    const query = new URLSearchParams({ ...(poses && { poses }), ...($('import-resume').checked && { resume: true }) });
    const path = `v1/maps/${encodeURIComponent(name)}/import?${query}`;
    const button = $('import').querySelector('button');
    button.disabled = true;
    const sent = await change(() => send(file, 'POST', path, 'application/octet-stream', $('import-progress')));
    button.disabled = false;
    if (!sent) return;
    $('import').reset();
    $('manager').close();
    seen = name;
    open(name);
  };
  // The name of the file is a good first guess.
  $('import-file').onchange = () => {
    const [file] = $('import-file').files;
    if (file && !$('import-name').value) $('import-name').value = mapName(file.name);
  };
  $('importing-stop').onclick = () => attempt(async () => {
    await call(api('/import'), { method: 'DELETE' });
    await watchImport();
  });
}

// A map's name made of a file's.
const mapName = (file) => file.replace(/\.\w+$/, '').replace(/[^A-Za-z0-9._-]+/g, '_').replace(/^\.+/, '').slice(0, 64);

// Shows how far a recording is mapped into the shown map, until it is.
export async function watchImport() {
  clearTimeout(timer);
  $('importing').hidden = true;
  const map = state.map;
  if (!map) return;
  const response = await call(api('/import'), { expected: [404, 503] }).catch(() => null);
  if (state.map !== map || !response?.ok) return;
  const told = await response.json();
  const hasEnded = told.state in ENDED;
  if (hasEnded && seen !== map) return;
  seen = map;
  draw(told);
  if (hasEnded) return;
  timer = setTimeout(watchImport, REFRESH_MILLIS);
}

function draw(told) {
  const { state: now, layout, poses, frames_done: done, frames_total: total } = told;
  const hasEnded = now in ENDED;
  const what = hasEnded ? ENDED[now] : 'Mapping a recording';
  const frames = `${done.toLocaleString('en')} of ${total.toLocaleString('en')} frames`;
  const details = [frames, layout, poses && `poses ${poses}`].filter(Boolean).join(', ');
  $('importing-text').textContent = `${what}: ${now === 'receiving' ? 'it is being received' : details}.`;
  $('importing-bar').max = Math.max(total, 1);
  $('importing-bar').value = done;
  $('importing-bar').hidden = $('importing-stop').hidden = hasEnded;
  const left = told.frames_left_out + told.frames_refused;
  const more = [
    told.error,
    told.frames_resumed_past > 0 && `The map had ${told.frames_resumed_past.toLocaleString('en')} of its frames before.`,
    left > 0 && `${left.toLocaleString('en')} frames cannot be used, for example:`,
    ...(told.problems ?? []),
    ...(told.notes ?? []),
  ].filter(Boolean);
  $('importing-more').replaceChildren(...more.map((text) => element('li', text)));
  $('importing').hidden = false;
}
