// The rendered view with the answer over it, and the plan.
import { attempt } from './page.js';
import { drawPlan } from './plan.js';
import { api, array, call } from './server.js';
import { $, state } from './state.js';

const PICTURE_WIDTH = 640;

export async function drawPicture() {
  const { map, chosen, channel } = state;
  if (chosen === null || channel === '3D') return;
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

// Depth as shades: near is bright, no depth is black.
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

// Color of a relevancy, and its opacity, 0 to 1: transparent below 0.4; 0.5 means that the text fits no better
// than anything else.
export function heatColor(relevancy) {
  const t = Math.min(1, Math.max(0, (relevancy - 0.4) / 0.5));
  return [255 * Math.min(1, 2 * t), 255 * (t < 0.5 ? 1.2 * t + 0.2 : 1.6 * (1 - t)), 255 * Math.max(0, 0.7 - 1.4 * t), Math.sqrt(t)];
}

// Draws the heat map or the labels of the answer over the view.
export function drawHeat() {
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
    const [r, g, b, share] = heatColor(value);
    image.data.set([r, g, b, 255 * strength * share], at * 4);
  });
  canvas.width = width;
  canvas.height = height;
  context.putImageData(image, 0, 0);
}

// Draws the boxes and the peak of an answer; removes them if `view` is null or does not show what was asked for.
export function drawMarks(view) {
  const svg = $('marks');
  svg.replaceChildren();
  if (!view?.heatmap || !view.present) return;
  svg.setAttribute('viewBox', `0 0 ${view.heatmap.width} ${view.heatmap.height}`);
  const add = (name, attributes) => {
    const mark = document.createElementNS('http://www.w3.org/2000/svg', name);
    for (const [key, value] of Object.entries(attributes)) mark.setAttribute(key, value);
    svg.append(mark);
  };
  (view.boxes ?? []).forEach(({ x, y, width, height }, at) => add('rect', { x, y, width, height, rx: 2, class: at === 0 ? 'first' : '' }));
  if (view.peak) add('circle', { cx: view.peak.x, cy: view.peak.y, r: view.heatmap.width / 80 });
}

export function drawPlanNow() {
  drawPlan($('plan'), state.frames, state.objects, $('plane').value, state.chosen);
}

// Removes what was drawn over the view.
export function clearView() {
  state.heat = null;
  state.labels = null;
  drawHeat();
  drawMarks(null);
}
