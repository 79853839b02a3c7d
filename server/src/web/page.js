// Helpers for the page: errors, throttling, elements.
import { $ } from './state.js';

export function show(error) {
  $('error').textContent = error ? error.message : '';
  $('error').hidden = !error;
}

// Runs a step and shows its error, if any; returns whether it succeeded.
export async function attempt(step) {
  try {
    await step();
    return true;
  } catch (error) {
    show(error);
    return false;
  }
}

// Runs `work` at most once per interval; calls during the interval cause one more run at its end.
export function throttled(work, millis) {
  let waiting = false;
  let again = false;
  return async function run() {
    if (waiting) { again = true; return; }
    waiting = true;
    await attempt(work);
    setTimeout(() => { waiting = false; if (again) { again = false; run(); } }, millis);
  };
}

export function element(tag, text, kind = '') {
  const made = document.createElement(tag);
  made.textContent = text;
  made.className = kind;
  return made;
}
