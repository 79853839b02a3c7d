// The page's address: map, frame, question, channel and camera of the 3D view, so that reloading and sharing keep them.
import { usualChannel } from './channels.js';
import { state } from './state.js';

// Writes the state behind the address's #; goes on in the same place of the history.
export function remember() {
  const { map, chosen, follows, question, channel, camera } = state;
  const parts = new URLSearchParams();
  if (map) parts.set('map', map);
  if (chosen !== null && !follows) parts.set('frame', chosen);
  if (question) parts.set('ask', question);
  if (channel !== usualChannel(parts.has('frame'))) parts.set('channel', channel);
  if (channel === '3D' && camera) parts.set('camera', written(camera));
  history.replaceState(null, '', `#${parts}`);
}

// The state that the address asks for; what it does not name is absent.
export function asked() {
  const parts = new URLSearchParams(location.hash.slice(1));
  const frame = parts.get('frame');
  return { map: parts.get('map'), frame: /^\d+$/.test(frame ?? '') ? Number(frame) : null, question: parts.get('ask') ?? '', channel: parts.get('channel') ?? usualChannel(frame !== null), camera: read(parts.get('camera') ?? '') };
}

// A camera as its mode and numbers: eye (x, y, z), yaw, pitch, distance.
function written({ mode, eye, yaw, pitch, distance }) {
  return [mode, ...[...eye, yaw, pitch, distance].map((value) => Number(value.toFixed(3)))].join('_');
}

function read(text) {
  const [mode, ...rest] = text.split('_');
  const [x, y, z, yaw, pitch, distance] = rest.map(Number);
  if (!['orbit', 'fly', 'walk'].includes(mode) || rest.length !== 6 || !rest.map(Number).every(Number.isFinite) || distance <= 0) return null;
  return { mode, eye: [x, y, z], yaw, pitch, distance };
}
