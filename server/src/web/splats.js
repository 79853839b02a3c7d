// The map's splats, fetched in pieces: what is most to be seen comes first.
import { attempt, throttled } from './page.js';
import { api, call } from './server.js';
import { state } from './state.js';

// Bytes of a splat: see the export splats.splat.
export const RECORD = 32;
// How many are fetched: for the 3D view (fewer where a finger points, on a phone), and for the plan alone.
const MOST = matchMedia('(pointer: coarse)').matches ? 500_000 : 2_000_000;
const FEW = 20_000;
// The first piece, and the time between pieces.
const FIRST = 2000;
const PIECE_MILLIS = 60;
const REFRESH_MILLIS = 2500;
const PLAN_MILLIS = 10_000;

// `map` is null until it is known what the map has.
const none = { map: null, revision: null, etag: null, limit: 0, count: 0, total: 0, bytes: null, floats: null };
let shown = none;

// The splats to show: {count, total, bytes, floats}; `count` of `total` have come. Another map or revision is
// another object. The event "splats" tells that there are more, or others.
export const splats = () => shown;

let refresh = async () => {};
// How many `refresh` fetches at most.
let most = 0;
export const refreshSplats = () => refresh();
const limitNow = () => (state.channel === '3D' ? MOST : FEW);

// Begins with another map.
export function openSplats() {
  show(none);
  begin();
}

// More or fewer splats are wanted than before.
export function resizeSplats() {
  if (most !== limitNow()) begin();
}

// Fetches from now on what is wanted now; what was being fetched is dropped.
function begin() {
  const { map } = state;
  const limit = limitNow();
  most = limit;
  refresh = throttled(() => load(map, limit), limit === MOST ? REFRESH_MILLIS : PLAN_MILLIS);
  refresh();
}

async function load(map, limit) {
  const isWanted = () => map !== null && map === state.map && limit === limitNow();
  if (!isWanted() || document.hidden) return;
  const began = performance.now();
  const headers = { range: `bytes=0-${limit * RECORD - 1}` };
  if (shown.map === map && shown.limit >= limit) headers['if-none-match'] = shown.etag;
  // 304: they are the same. 416: there are none.
  const response = await call(api('/export/splats.splat'), { headers, expected: [304, 416] });
  if (!isWanted()) return;
  if (response.status === 416) show({ ...none, map });
  if (!response.ok) return;
  await read(response, isWanted, { ...none, map, limit, etag: response.headers.get('etag'), revision: Number(response.headers.get('lexsplat-revision')) });
  // A slow connection is not kept busy.
  await new Promise((resolve) => { setTimeout(resolve, performance.now() - began); });
}

// Shows the splats of a body as they come; those of a later revision when as many have come as are shown.
async function read(response, isWanted, next) {
  const length = Number(response.headers.get('content-length'));
  const whole = length > 0 ? null : new Uint8Array(await response.arrayBuffer());
  next.bytes = whole ?? new Uint8Array(length);
  next.floats = new Float32Array(next.bytes.buffer, 0, Math.floor(next.bytes.length / 4));
  next.total = Math.floor(next.bytes.length / RECORD);
  let [at, last] = [whole?.length ?? 0, 0];
  const isEnough = () => (shown.map === next.map && shown !== next ? next.count >= Math.min(shown.count, next.total) : next.count >= FIRST);
  const reader = whole ? null : response.body.getReader();
  for (let done = whole !== null; !done;) {
    const piece = await reader.read();
    if (!isWanted()) { await reader.cancel(); return; }
    done = piece.done;
    if (done) break;
    next.bytes.set(piece.value, at);
    at += piece.value.length;
    next.count = Math.floor(at / RECORD);
    if (isEnough() && performance.now() - last > PIECE_MILLIS) {
      show(next);
      // Lets the page draw it.
      await new Promise((resolve) => { setTimeout(resolve); });
      last = performance.now();
    }
  }
  next.count = Math.floor(at / RECORD);
  show(next);
}

function show(next) {
  shown = next;
  document.dispatchEvent(new Event('splats'));
}

document.addEventListener('visibilitychange', () => { if (!document.hidden) attempt(refreshSplats); });
