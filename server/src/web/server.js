// Requests to the server.
import { $, state } from './state.js';

// `expected`: statuses that are no errors, beside those of success.
export async function call(path, { expected = [], ...options } = {}) {
  let response;
  try {
    response = await fetch(path, { cache: 'no-store', ...options });
  } catch {
    throw new Error('the server does not answer');
  }
  if (!response.ok && !expected.includes(response.status)) {
    if (response.status === 401 && $('login').hidden) {
      $('login').hidden = false;
      $('token').focus();
    }
    const problem = await response.json().catch(() => ({}));
    throw new Error(problem.detail ?? `${response.status} ${response.statusText}`);
  }
  return response;
}

// Addresses are relative to the page's: a proxy may show it below a path.
// Path below the shown map.
export const api = (rest = '') => `v1/maps/${encodeURIComponent(state.map)}${rest}`;
// Address of a part of an answer, which is relative to that of the question.
export const linked = (url) => new URL(url, new URL(api('/query'), document.baseURI));
export const json = async (path, options) => (await call(path, options)).json();

// Fetches a float32 .npy file (format version 1) as {shape, values}.
export async function array(path) {
  const response = await call(path, { headers: { accept: 'application/x-npy' } });
  const buffer = await response.arrayBuffer();
  const length = new DataView(buffer).getUint16(8, true);
  const header = new TextDecoder().decode(new Uint8Array(buffer, 10, length));
  const shape = header.match(/'shape': \(([^)]*)\)/)[1].split(',').map((s) => s.trim()).filter(Boolean).map(Number);
  return { shape, values: new Float32Array(buffer.slice(10 + length)) };
}

// Sends a file and shows on a bar how far it is, which fetch cannot tell.
export function send(file, method, path, type, bar) {
  const request = new XMLHttpRequest();
  return new Promise((done, failed) => {
    request.open(method, path);
    request.setRequestHeader('content-type', type);
    request.upload.onprogress = ({ loaded, total }) => { bar.max = total; bar.value = loaded; };
    request.onload = () => {
      if (request.status < 300) { done(); return; }
      let detail = `${request.status} ${request.statusText}`;
      try { detail = JSON.parse(request.responseText).detail ?? detail; } catch { /* It is no problem in JSON. */ }
      failed(new Error(detail));
    };
    request.onerror = () => failed(new Error('the server does not answer'));
    bar.removeAttribute('value');
    bar.hidden = false;
    request.send(file);
  }).finally(() => { bar.hidden = true; });
}
