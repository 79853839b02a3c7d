// The state of the page: the map, its keyframes, the chosen view and the last answer.

export const $ = (id) => document.getElementById(id);

export const state = {
  map: null,
  // Whether the server is still loading it.
  loading: false,
  // Keyframes of the map, oldest first.
  frames: [],
  // Sequence number of the keyframe in view.
  chosen: null,
  channel: 'color',
  // EventSource of the map.
  events: null,
  // Heat map {shape, values} or label image over the view.
  heat: null,
  labels: null,
  // Objects of the last answer.
  objects: [],
  // Number of questions asked: answers to older questions are dropped.
  asked: 0,
};
