// What the stage shows: the 3D view, or a channel of the rendered view.

let can3d = null;

// Whether this browser has WebGL2.
export function has3d() {
  if (can3d === null) {
    const context = document.createElement('canvas').getContext('webgl2');
    can3d = context !== null;
    context?.getExtension('WEBGL_lose_context')?.loseContext();
  }
  return can3d;
}

// What is shown if nobody says: a frame that somebody asked for as its picture.
export const usualChannel = (hasFrame) => (hasFrame || !has3d() ? 'color' : '3D');
