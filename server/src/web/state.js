// The state of the page: the map, its keyframes, the chosen view, the question and its answer.

export const $ = (id) => document.getElementById(id);

export const state = {
  map: null,
  // Whether the server is still loading it.
  loading: false,
  // Whether the map had done its work when its status was drawn last.
  settled: false,
  // Keyframes of the map, oldest first.
  frames: [],
  // Sequence number of the keyframe in view.
  chosen: null,
  // Whether the newest keyframe is chosen as they come.
  follows: true,
  // '3D', or a channel of the rendered view.
  channel: 'color',
  // Camera of the 3D view {mode, eye, yaw, pitch, distance}; null: where the page puts it.
  camera: null,
  // EventSource of the map.
  events: null,
  // The question that is answered, or that is being answered; empty if there is none.
  question: '',
  // Heat map {shape, values} or label image over the view.
  heat: null,
  labels: null,
  // The last answer about the whole map: {space: the reply, legend: its labels, or null}; null if there is none.
  answer: null,
  // Objects of the last answer.
  objects: [],
  // Number of questions asked: answers to older questions are dropped.
  asked: 0,
};
