// The camera of the 3D view and how pointer, keys and buttons move it.
//
// Coordinates: metres, y up. The camera looks along `ahead`: yaw 0 is -z, pitch 0 is level.

const LOOK_PER_PIXEL = 0.004;
const STEEPEST = Math.PI / 2 - 0.01;
// Metres a second, and radians a second of the arrow keys; with Shift thrice that.
const SPEED = 1.5;
const TURN = 1.2;
const GLIDE_MILLIS = 500;
const KEYS = {
  KeyW: 'forward', ArrowUp: 'forward', KeyS: 'back', ArrowDown: 'back', KeyA: 'left', KeyD: 'right',
  ArrowLeft: 'turnLeft', ArrowRight: 'turnRight', KeyE: 'up', PageUp: 'up', KeyQ: 'down', PageDown: 'down',
};

const clamp = (value, least, most) => Math.min(most, Math.max(least, value));
const add = (a, b, times = 1) => a.map((value, at) => value + times * b[at]);

export const ahead = ({ yaw, pitch }) => [-Math.sin(yaw) * Math.cos(pitch), Math.sin(pitch), -Math.cos(yaw) * Math.cos(pitch)];
// Yaw and pitch of a direction.
export const towards = ([x, y, z]) => ({ yaw: Math.atan2(-x, -z), pitch: clamp(Math.atan2(y, Math.hypot(x, z)), -STEEPEST, STEEPEST) });

// `moved` is called after every change.
export class Motion {
  constructor(moved) {
    // Orbit turns about the point `distance` ahead of the eye. Walk keeps the eye at `height`, if that is known.
    Object.assign(this, { mode: 'orbit', eye: [0, 0, 0], yaw: 0, pitch: 0, distance: 2, height: null });
    this.moved = moved;
    this.held = new Set();
    this.pointers = new Map();
    this.glide = null;
    this.last = null;
  }

  pose() {
    const { mode, eye, yaw, pitch, distance } = this;
    return { mode, eye, yaw, pitch, distance };
  }

  // Moves at once, or in half a second.
  go(pose, smoothly = false) {
    const still = !smoothly || matchMedia('(prefers-reduced-motion: reduce)').matches;
    if (still) {
      this.glide = null;
      Object.assign(this, pose);
      this.changed();
      return;
    }
    const turn = (from, to) => from + Math.atan2(Math.sin(to - from), Math.cos(to - from));
    const to = { ...this.pose(), ...pose };
    this.glide = { from: this.pose(), to: { ...to, yaw: turn(this.yaw, to.yaw) }, began: performance.now() };
    this.run();
  }

  setMode(mode) {
    this.mode = mode;
    if (mode === 'walk' && this.height !== null) this.go({ eye: [this.eye[0], this.height, this.eye[2]], pitch: clamp(this.pitch, -0.6, 0.6) }, true);
    else this.changed();
  }

  changed() {
    if (this.mode === 'walk' && this.height !== null && !this.glide) this.eye = [this.eye[0], this.height, this.eye[2]];
    this.moved();
  }

  turn(across, up) {
    const center = add(this.eye, ahead(this), this.distance);
    this.yaw += across;
    this.pitch = clamp(this.pitch + up, -STEEPEST, STEEPEST);
    if (this.mode === 'orbit') this.eye = add(center, ahead(this), -this.distance);
    this.changed();
  }

  // Nearer to what is looked at, or forward.
  advance(metres) {
    if (this.mode === 'orbit') {
      const nearer = clamp(this.distance - metres, 0.1, 1000);
      this.eye = add(this.eye, ahead(this), this.distance - nearer);
      this.distance = nearer;
    } else {
      const level = this.mode === 'walk' ? { yaw: this.yaw, pitch: 0 } : this;
      this.eye = add(this.eye, ahead(level), metres);
    }
    this.changed();
  }

  // To the side and up, metres.
  shift(across, up) {
    const right = [Math.cos(this.yaw), 0, -Math.sin(this.yaw)];
    const above = ahead({ yaw: this.yaw, pitch: this.pitch + Math.PI / 2 });
    this.eye = add(add(this.eye, right, across), above, up);
    this.changed();
  }

  // Moves while a key or a button is held.
  hold(what, on) {
    if (!on) this.tick();
    if (on) this.held.add(what);
    else this.held.delete(what);
    if (on) this.glide = null;
    this.run();
  }

  // Moves by what is held, for the time since the last time. A slow picture slows nobody down.
  tick() {
    if (this.last === null) return;
    const now = performance.now();
    const seconds = Math.min(0.3, (now - this.last) / 1000);
    this.last = now;
    if (this.held.size) this.push(seconds * (this.held.has('fast') ? 3 : 1));
  }

  run() {
    if (this.last !== null) return;
    this.last = performance.now();
    const step = () => {
      if (this.glide) this.slide(performance.now());
      this.tick();
      if (this.glide || [...this.held].some((what) => what !== 'fast')) requestAnimationFrame(step);
      else this.last = null;
    };
    requestAnimationFrame(step);
  }

  slide(now) {
    const { from, to, began } = this.glide;
    const linear = clamp((now - began) / GLIDE_MILLIS, 0, 1);
    const t = linear * linear * (3 - 2 * linear);
    const mix = (a, b) => a + t * (b - a);
    Object.assign(this, { eye: from.eye.map((value, at) => mix(value, to.eye[at])), yaw: mix(from.yaw, to.yaw), pitch: mix(from.pitch, to.pitch), distance: mix(from.distance, to.distance), mode: to.mode });
    if (linear === 1) this.glide = null;
    this.changed();
  }

  push(seconds) {
    const sign = (more, less) => Number(this.held.has(more)) - Number(this.held.has(less));
    const metres = SPEED * seconds;
    const inOrbit = this.mode === 'orbit';
    const across = sign('turnLeft', 'turnRight');
    if (across) this.turn((inOrbit ? -1 : 1) * across * TURN * seconds, 0);
    const on = sign('forward', 'back');
    if (on) this.advance(metres * on * (inOrbit ? this.distance / 2 : 1));
    const [right, up] = [sign('right', 'left'), sign('up', 'down')];
    if (inOrbit && (right || up)) this.turn(right * TURN * seconds, -up * TURN * seconds);
    else if (right || up) this.shift(metres * right, metres * up);
  }

  // Listens to a canvas. `clicked(x, y)` gets clicks that were no drags.
  listen(canvas, clicked) {
    const release = () => { this.held.clear(); };
    canvas.addEventListener('keydown', (event) => {
      const what = KEYS[event.code];
      if (!what || event.ctrlKey || event.metaKey || event.altKey) return;
      // Elsewhere the arrow keys choose the keyframe.
      event.preventDefault();
      event.stopPropagation();
      this.hold('fast', event.shiftKey);
      this.hold(what, true);
    });
    canvas.addEventListener('keyup', (event) => { if (KEYS[event.code]) this.hold(KEYS[event.code], false); });
    canvas.addEventListener('blur', release);
    canvas.addEventListener('contextmenu', (event) => event.preventDefault());
    canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      this.glide = null;
      const notches = clamp(event.deltaY / (event.deltaMode === 1 ? 3 : 100), -3, 3);
      this.advance(-notches * (this.mode === 'orbit' ? 0.15 * this.distance : 0.25));
    }, { passive: false });
    canvas.addEventListener('pointerdown', (event) => {
      canvas.focus();
      canvas.setPointerCapture(event.pointerId);
      this.glide = null;
      this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY, button: event.button, far: 0, alone: this.pointers.size === 0 });
    });
    canvas.addEventListener('pointermove', (event) => this.drag(event, canvas));
    const up = (event) => {
      const pointer = this.pointers.get(event.pointerId);
      this.pointers.delete(event.pointerId);
      if (event.type === 'pointerup' && pointer?.alone && pointer.far < 6 && pointer.button === 0) {
        const place = canvas.getBoundingClientRect();
        clicked(event.clientX - place.left, event.clientY - place.top);
      }
    };
    canvas.addEventListener('pointerup', up);
    canvas.addEventListener('pointercancel', up);
  }

  drag(event, canvas) {
    const pointer = this.pointers.get(event.pointerId);
    if (!pointer) return;
    const [x, y] = [event.clientX - pointer.x, event.clientY - pointer.y];
    const spread = () => {
      const [a, b] = [...this.pointers.values()];
      return Math.hypot(a.x - b.x, a.y - b.y);
    };
    const before = this.pointers.size === 2 ? spread() : 0;
    Object.assign(pointer, { x: event.clientX, y: event.clientY, far: pointer.far + Math.hypot(x, y) });
    if (pointer.far < 6 && pointer.alone && this.pointers.size === 1) return;
    // Metres a pixel at the distance of what is looked at.
    const scale = (this.mode === 'orbit' ? this.distance : 2) / canvas.clientHeight;
    if (this.pointers.size === 2) {
      for (const other of this.pointers.values()) other.alone = false;
      this.advance((spread() - before) * 2 * scale);
      this.shift(-x * scale / 2, y * scale / 2);
    } else if (this.pointers.size === 1) {
      if (pointer.button === 2 || event.shiftKey) this.shift(-x * scale, y * scale);
      else if (this.mode === 'orbit') this.turn(-x * LOOK_PER_PIXEL * 1.5, -y * LOOK_PER_PIXEL * 1.5);
      else this.turn(x * LOOK_PER_PIXEL, y * LOOK_PER_PIXEL);
    }
  }
}
