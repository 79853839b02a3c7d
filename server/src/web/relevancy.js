// How well each splat fits the question, as colors.
import { attempt } from './page.js';
import { api, array, json, linked } from './server.js';
import { RECORD, splats } from './splats.js';
import { state } from './state.js';
import { heatColor } from './view.js';

// A splat of another revision than the answer has the relevancy of the nearest point of the answer, metres.
const REACH = 0.05;
const FLOATS = RECORD / 4;

// Of the last answer: rows (x, y, z, label, score) in a grid, and the labels' colors.
let scores = null;
// The row of each splat, -1 for none, of these splats and scores.
let rows = { of: null, with: null, index: new Int32Array(0), count: 0 };

// The answer has changed: fetches what it says of each splat. The event "scores" tells that it has come.
document.addEventListener('answered', () => attempt(async () => {
  const { answer, map } = state;
  const found = answer && state.channel === '3D' ? await scoresOf(answer) : null;
  if (answer !== state.answer || map !== state.map) return;
  scores = found;
  document.dispatchEvent(new Event('scores'));
}));

async function scoresOf({ space, legend }) {
  const found = space.points && legend ? space : await segmented(space.understood);
  const { shape: [count], values } = await array(linked(found.points.url));
  return { values, count, grid: grid(values, count), legend: legend?.map(({ color }) => bytesOf(color)), revision: found.revision };
}

// Each place of the map, compared with the thing that was understood alone.
function segmented({ object, attributes = [] }) {
  const body = JSON.stringify({ texts: [[...attributes, object].join(' ')] });
  return json(api('/query'), { method: 'POST', headers: { 'content-type': 'application/json' }, body });
}

const bytesOf = (color) => [1, 3, 5].map((at) => parseInt(color.slice(at, at + 2), 16));

// Writes the colors of splats `from`..`to`, 0 to 255, mixed with those of the answer.
export function paint(colors, from, to, strength) {
  const all = splats();
  const found = scores && rowsOf(all, to);
  for (let at = from; at < to; at += 1) {
    const own = at * RECORD + 24;
    const mixed = found && found[at] >= 0 ? colorOf(found[at], strength) : null;
    for (let channel = 0; channel < 3; channel += 1) {
      const value = all.bytes[own + channel];
      colors[at * 3 + channel] = mixed ? value + mixed[3] * (mixed[channel] - value) : value;
    }
  }
}

function colorOf(row, strength) {
  const { values, legend } = scores;
  const [label, score] = [values[row * 5 + 3], values[row * 5 + 4]];
  if (!legend) {
    const [r, g, b, share] = heatColor(score);
    return [r, g, b, share * strength];
  }
  const color = legend[label - 1];
  return color ? [...color, strength] : [0, 0, 0, 0];
}

function rowsOf(all, to) {
  if (rows.of !== all || rows.with !== scores) {
    rows = { of: all, with: scores, index: new Int32Array(all.total), count: 0 };
  }
  const reach = all.revision === scores.revision ? 0 : REACH;
  for (; rows.count < to; rows.count += 1) {
    const f = rows.count * FLOATS;
    rows.index[rows.count] = nearest(scores, all.floats[f], all.floats[f + 1], all.floats[f + 2], reach);
  }
  return rows.index;
}

// Cells as long as REACH, as lists of rows: the first of each cell, and the next after each.
function grid(values, count) {
  const cells = 2 ** Math.max(8, Math.ceil(Math.log2(count + 1)));
  const first = new Int32Array(cells).fill(-1);
  const next = new Int32Array(count);
  for (let row = 0; row < count; row += 1) {
    const cell = cellAt(values[row * 5], values[row * 5 + 1], values[row * 5 + 2], cells);
    next[row] = first[cell];
    first[cell] = row;
  }
  return { cells, first, next };
}

function cellAt(x, y, z, cells) {
  const [i, j, k] = [x, y, z].map((value) => Math.floor(value / REACH));
  return (Math.imul(i, 73856093) ^ Math.imul(j, 19349663) ^ Math.imul(k, 83492791)) & (cells - 1);
}

// The row at a place, or else the nearest one within `reach`.
function nearest({ values, grid: { cells, first, next } }, x, y, z, reach) {
  let [best, least] = [-1, reach * reach];
  const look = (cell) => {
    for (let row = first[cell]; row >= 0; row = next[row]) {
      const off = (values[row * 5] - x) ** 2 + (values[row * 5 + 1] - y) ** 2 + (values[row * 5 + 2] - z) ** 2;
      if (off <= least) [best, least] = [row, off];
    }
  };
  look(cellAt(x, y, z, cells));
  if (reach === 0 || (best >= 0 && least === 0)) return best;
  for (const i of [-REACH, 0, REACH]) for (const j of [-REACH, 0, REACH]) for (const k of [-REACH, 0, REACH]) look(cellAt(x + i, y + j, z + k, cells));
  return best;
}
