// Logging in and out. The server keeps the token in a cookie that scripts cannot read.
import { attempt } from './page.js';
import { call } from './server.js';
import { $ } from './state.js';

// Whether this browser logged in: only for showing the button.
const LOGGED_IN = 'lexsplat-logged-in';

export function listenForLogin() {
  $('logout').hidden = !localStorage.getItem(LOGGED_IN);
  $('login').onsubmit = async (event) => {
    event.preventDefault();
    const body = JSON.stringify({ token: $('token').value.trim() });
    const headers = { 'content-type': 'application/json' };
    if (!(await attempt(() => call('v1/session', { method: 'POST', headers, body })))) return;
    localStorage.setItem(LOGGED_IN, 'yes');
    location.reload();
  };
  $('logout').onclick = async () => {
    if (!(await attempt(() => call('v1/session', { method: 'DELETE' })))) return;
    localStorage.removeItem(LOGGED_IN);
    location.reload();
  };
}
