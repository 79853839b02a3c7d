// The strip of keyframes, and choosing one of them.
import { throttled } from './page.js';
import { api, json } from './server.js';
import { $, state } from './state.js';
import { clearAnswer, drawPicture, drawPlanNow } from './view.js';

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
  showChosen($('strip'));
  drawPicture();
  drawPlanNow();
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
  if (next) { $('follow').checked = false; choose(next.sequence); }
}
