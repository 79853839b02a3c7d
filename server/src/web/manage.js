// The dialog that manages maps: make, open, rename, delete, download, back up and restore them, and map recordings.
import { element } from './page.js';
import { listenForImports } from './imports.js';
import { call, json, send } from './server.js';
import { $, state } from './state.js';

const REFRESH_MILLIS = 2000;

// Files of a map, and what they are for.
const FILES = [
  ['export/splats.ply', 'Gaussians (.ply), for splat viewers'],
  ['export/splats.splat', 'Gaussians (.splat), for web viewers'],
  ['export/splats.spz', 'Gaussians (.spz), compressed'],
  ['export/splats.glb', 'Gaussians (.glb), glTF'],
  ['export/mesh.ply', 'mesh (.ply)'],
  ['export/points.ply', 'points (.ply)'],
  ['export/language.npz', 'Gaussians with language (.npz), for numpy'],
  ['export/trajectory.tum', 'trajectory (.tum)'],
  ['export/trajectory.json', 'trajectory with covariances (.json)'],
  ['backup', 'backup (.tar), to restore it here or elsewhere'],
];

const address = (map, rest = '') => `v1/maps/${encodeURIComponent(map)}${rest}`;
const body = (value) => ({ headers: { 'content-type': 'application/json' }, body: JSON.stringify(value) });

// `open` shows a map; `changed` is called after maps came or went.
export function listenForManaging(open, changed) {
  const dialog = $('manager');
  let timer = null;
  // Name of the map that is being renamed, or whose deletion waits for a second click.
  let renames = null;
  let deletes = null;
  // Name of the map whose files are listed.
  let lists = null;

  function show(error) {
    $('manager-error').textContent = error?.message ?? '';
    $('manager-error').hidden = !error;
  }

  // Runs a step that changes maps; shows its error, if any. Returns whether it succeeded.
  async function change(step) {
    let failure = null;
    try {
      await step();
      renames = deletes = null;
      await changed();
    } catch (error) {
      failure = error;
    }
    show(failure);
    await list();
    return !failure;
  }

  async function list() {
    try {
      const { maps } = await json('v1/maps');
      if (renames === null || !maps.some((map) => map.name === renames)) draw(maps);
    } catch (error) {
      show(error);
    }
  }

  function draw(maps) {
    const focused = document.activeElement?.dataset.key;
    const rows = maps.flatMap((map) => (map.name === lists ? [row(map), files(map.name)] : [row(map)]));
    if (rows.length === 0) {
      rows.push(document.createElement('tr'));
      const cell = element('td', 'no map yet', 'quiet');
      cell.colSpan = 6;
      rows[0].append(cell);
    }
    $('manager-maps').replaceChildren(...rows);
    if (focused) $('manager').querySelector(`[data-key="${CSS.escape(focused)}"]`)?.focus();
  }

  function row(map) {
    const made = document.createElement('tr');
    const bytes = map.gpu_bytes + map.keyframe_bytes;
    made.append(
      named(map),
      element('td', doing(map)),
      element('td', map.frames_received.toLocaleString('en'), 'wide'),
      element('td', map.gaussians.toLocaleString('en'), 'wide'),
      element('td', `${(bytes / 1e6).toFixed(0)} MB`, 'wide'),
      actions(map),
    );
    return made;
  }

  function named(map) {
    const cell = document.createElement('td');
    if (renames !== map.name) {
      cell.append(button(map.name, 'open', map.name, () => { dialog.close(); open(map.name); }, 'link'));
      return cell;
    }
    const form = document.createElement('form');
    const input = document.createElement('input');
    Object.assign(input, { value: map.name, required: true, maxLength: 64 });
    input.setAttribute('aria-label', `new name of ${map.name}`);
    form.append(input, element('button', 'Rename'));
    form.onsubmit = (event) => {
      event.preventDefault();
      const name = input.value.trim();
      const isShown = state.map === map.name;
      change(async () => {
        if (name !== map.name) await call(address(map.name), { method: 'PATCH', ...body({ name }) });
        if (isShown) open(name);
      });
    };
    form.onkeydown = (event) => {
      if (event.key !== 'Escape') return;
      event.preventDefault();
      renames = null;
      list();
    };
    cell.append(form);
    return cell;
  }

  function actions(map) {
    const cell = document.createElement('td');
    const download = button('Download', 'download', map.name, () => {
      lists = lists === map.name ? null : map.name;
      list();
    });
    download.setAttribute('aria-expanded', String(lists === map.name));
    const rename = button('Rename', 'rename', map.name, () => {
      renames = null;
      const wanted = map.name;
      json('v1/maps').then(({ maps }) => {
        renames = wanted;
        draw(maps);
        $('manager').querySelector('tbody form input')?.select();
      }, show);
    });
    const asks = deletes === map.name;
    const remove = button(asks ? 'Delete for ever' : 'Delete', 'delete', map.name, () => {
      if (asks) { change(() => call(address(map.name), { method: 'DELETE' })); return; }
      deletes = map.name;
      list();
    }, asks ? 'danger' : '');
    cell.append(download, rename, remove);
    cell.className = 'actions';
    return cell;
  }

  // The row that lists the files of a map.
  function files(map) {
    const list = element('ul', '', 'files');
    list.append(...FILES.map(([path, text]) => {
      const item = document.createElement('li');
      const link = element('a', text);
      link.href = address(map, `/${path}`);
      link.download = `${map}-${path.split('/').at(-1)}${path === 'backup' ? '.tar' : ''}`;
      item.append(link);
      return item;
    }));
    const cell = document.createElement('td');
    cell.colSpan = 6;
    cell.append(list);
    const made = document.createElement('tr');
    made.append(cell);
    return made;
  }

  function button(text, what, map, click, kind = '') {
    const made = element('button', text, kind);
    made.type = 'button';
    made.dataset.key = `${what} ${map}`;
    if (what !== 'open') made.setAttribute('aria-label', `${text} ${map}`);
    made.onclick = click;
    return made;
  }

  $('create').onsubmit = (event) => {
    event.preventDefault();
    const name = $('create-name').value.trim();
    change(async () => {
      await call('v1/maps', { method: 'POST', ...body({ name }) });
      $('create-name').value = '';
    });
  };
  $('restore').onsubmit = (event) => {
    event.preventDefault();
    const [file] = $('restore-file').files;
    const name = $('restore-name').value.trim();
    change(async () => {
      await send(file, 'PUT', address(name, '/backup'), 'application/x-tar', $('restore-progress'));
      $('restore').reset();
    });
  };
  // The name that the file was saved with is a good first guess.
  $('restore-file').onchange = () => {
    const [file] = $('restore-file').files;
    if (file && !$('restore-name').value) $('restore-name').value = file.name.replace(/(-backup|\.lexsplat)?\.tar$/, '');
  };
  listenForImports(open, change);
  for (const opener of document.querySelectorAll('[data-opens=manager]')) {
    opener.onclick = () => {
      show(null);
      renames = deletes = lists = null;
      dialog.showModal();
      list();
      timer = setInterval(list, REFRESH_MILLIS);
    };
  }
  dialog.onclose = () => clearInterval(timer);
  $('manager-close').onclick = () => dialog.close();
}

// What the server does with a map.
function doing({ state: kind, loading, settled, refinement, frames_received: frames }) {
  if (kind === 'failed') return 'failed';
  if (kind === 'loading') return loading?.frames_total ? `loading, ${loading.frames_done} of ${loading.frames_total} frames` : 'waits to be loaded';
  if (frames === 0) return 'empty';
  if (!settled) return 'working';
  return ['refining', 'converged'].includes(refinement) ? refinement : 'settled';
}
