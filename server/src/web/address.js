// The page's address: map, frame, question and channel, so that reloading and sharing keep them.
import { state } from './state.js';

// Writes the state behind the address's #; goes on in the same place of the history.
export function remember() {
  const { map, chosen, follows, question, channel } = state;
  const parts = new URLSearchParams();
  if (map) parts.set('map', map);
  if (chosen !== null && !follows) parts.set('frame', chosen);
  if (question) parts.set('ask', question);
  if (channel !== 'color') parts.set('channel', channel);
  history.replaceState(null, '', `#${parts}`);
}

// The state that the address asks for; what it does not name is absent.
export function asked() {
  const parts = new URLSearchParams(location.hash.slice(1));
  const frame = parts.get('frame');
  return { map: parts.get('map'), frame: /^\d+$/.test(frame ?? '') ? Number(frame) : null, question: parts.get('ask') ?? '', channel: parts.get('channel') ?? 'color' };
}
