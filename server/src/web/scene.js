// What the 3D view draws: splats, and lines over them. Loaded with its renderer when it is first shown.
//
// Splats and lines are in the map's coordinates, the camera in coordinates with y up; metres.
import {
  Color, Group, LineMaterial, LineSegments2, LineSegmentsGeometry, Matrix4, PackedSplats, PerspectiveCamera,
  Quaternion, Scene, SparkRenderer, SplatMesh, Vector3, WebGLRenderer, setPackedSplat,
} from './splat-renderer.js';
import { paint } from './relevancy.js';
import { RECORD, splats } from './splats.js';
import { ahead } from './motion.js';

const FLOATS = RECORD / 4;
// Vertical field of view, degrees, of a picture as wide as 4:3; a narrower one sees as much across.
const FIELD = 55;
const WIDEST = 85;

export class View {
  constructor(canvas, drawn) {
    this.canvas = canvas;
    this.drawn = drawn;
    this.renderer = new WebGLRenderer({ canvas, antialias: false });
    this.renderer.setClearColor(0x05070b);
    this.camera = new PerspectiveCamera(FIELD, 4 / 3, 0.02, 1000);
    this.spark = new SparkRenderer({ renderer: this.renderer, onDirty: () => this.ask(), enableLod: false });
    this.scene = new Scene();
    // Turns the map upright; what is inside is relative to `origin`, which keeps small numbers small.
    this.upright = new Group();
    this.inner = new Group();
    this.upright.add(this.inner);
    this.scene.add(this.spark, this.upright);
    this.origin = [0, 0, 0];
    this.lines = new Map();
    this.asked = false;
    this.of = null;
    this.mesh = null;
    this.colors = new Uint8Array(0);
    // Height above the map's origin from which on splats are hidden, along `up`; null: none are.
    this.cut = null;
    this.up = [0, 1, 0];
  }

  // Draws once, soon.
  ask() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      if (this.canvas.clientWidth === 0) return;
      this.renderer.render(this.scene, this.camera);
      this.drawn();
    });
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    const half = Math.tan((FIELD / 360) * Math.PI) * Math.max(1, (4 / 3) / this.camera.aspect);
    this.camera.fov = Math.min(WIDEST, (Math.atan(half) * 360) / Math.PI);
    this.camera.updateProjectionMatrix();
    this.ask();
  }

  // Places the camera.
  look(motion) {
    this.camera.position.set(...motion.eye);
    this.camera.lookAt(...motion.eye.map((value, at) => value + ahead(motion)[at]));
    this.camera.updateMatrixWorld();
    this.ask();
  }

  // The map's direction up. Quarter turns bring the nearest axis to y and the smallest rotation the rest, so
  // that a small change of up does not turn the map about it. Returns the turn since the last time.
  setUp(direction) {
    const up = new Vector3(...direction).normalize();
    this.up = up.toArray();
    const size = [up.x, up.y, up.z].map(Math.abs);
    const at = size.indexOf(Math.max(...size));
    const axis = new Vector3().setComponent(at, Math.sign(up.getComponent(at)));
    const y = new Vector3(0, 1, 0);
    const quarters = axis.y < -0.5 ? new Quaternion(1, 0, 0, 0) : new Quaternion().setFromUnitVectors(axis, y);
    const rest = new Quaternion().setFromUnitVectors(up.applyQuaternion(quarters), y);
    const before = this.upright.quaternion.clone();
    this.upright.quaternion.copy(rest.multiply(quarters));
    this.upright.updateMatrixWorld(true);
    this.ask();
    return (eye) => new Vector3(...eye).applyQuaternion(before.invert()).applyQuaternion(this.upright.quaternion).toArray();
  }

  // From the map's coordinates to those of the camera, and back.
  toUp(point) { return new Vector3(...point).applyQuaternion(this.upright.quaternion).toArray(); }
  toMap(point) { return new Vector3(...point).applyQuaternion(this.upright.quaternion.clone().invert()).toArray(); }

  // Takes what has come of the splats.
  update(strength) {
    const all = splats();
    if (this.of !== all) {
      this.drop();
      this.of = all;
      if (all.count) this.begin(all);
    }
    if (all.count) this.fill(all, strength);
    else this.ask();
  }

  begin(all) {
    this.origin = [0, 1, 2].map((at) => Math.round(all.floats[at]));
    this.inner.position.set(...this.origin);
    this.packed = new PackedSplats({ packedArray: new Uint32Array(Math.ceil(all.total / 2048) * 2048 * 4), numSplats: 0, maxSplats: Math.ceil(all.total / 2048) * 2048 });
    this.mesh = new SplatMesh({ packedSplats: this.packed });
    this.colors = new Uint8Array(all.total * 3);
    this.filled = 0;
    this.inner.add(this.mesh);
    for (const [name, { points, colors, width }] of this.lines) this.draw(name, points, colors, width);
    this.upright.updateMatrixWorld(true);
  }

  fill(all, strength) {
    const { floats, bytes, count } = all;
    const { filled: from, packed, colors } = this;
    paint(colors, from, count, strength);
    const [x, y, z] = this.origin;
    for (let at = from; at < count; at += 1) {
      const f = at * FLOATS;
      const b = at * RECORD + 24;
      const turn = (part) => (bytes[b + part] - 128) / 128;
      setPackedSplat(packed.packedArray, at, floats[f] - x, floats[f + 1] - y, floats[f + 2] - z, floats[f + 3], floats[f + 4], floats[f + 5], turn(5), turn(6), turn(7), turn(4), this.isCut(all, at) ? 0 : bytes[b + 3] / 255, colors[at * 3] / 255, colors[at * 3 + 1] / 255, colors[at * 3 + 2] / 255);
    }
    this.filled = count;
    this.changed();
  }

  isCut({ floats }, at) {
    const f = at * FLOATS;
    return this.cut !== null && floats[f] * this.up[0] + floats[f + 1] * this.up[1] + floats[f + 2] * this.up[2] > this.cut;
  }

  // Hides what is higher: who looks from above sees into the rooms.
  setCut(height) {
    if (this.cut === height) return;
    this.cut = height;
    if (!this.mesh) return;
    const { packed: { packedArray }, filled } = this;
    for (let at = 0; at < filled; at += 1) {
      const opacity = this.isCut(this.of, at) ? 0 : this.of.bytes[at * RECORD + 27];
      packedArray[at * 4] = (packedArray[at * 4] & 0x00ffffff) | (opacity << 24);
    }
    this.changed();
  }

  // The answer, or how strongly it is shown, is another.
  recolor(strength) {
    if (!this.mesh) return;
    const { packed, colors, filled } = this;
    paint(colors, 0, filled, strength);
    for (let at = 0; at < filled; at += 1) {
      packed.packedArray[at * 4] = (packed.packedArray[at * 4] & 0xff000000) | colors[at * 3] | (colors[at * 3 + 1] << 8) | (colors[at * 3 + 2] << 16);
    }
    this.changed();
  }

  changed() {
    this.packed.numSplats = this.filled;
    this.packed.needsUpdate = true;
    this.mesh.numSplats = this.filled;
    this.mesh.updateVersion();
    this.ask();
  }

  drop() {
    this.mesh?.removeFromParent();
    this.mesh?.dispose();
    this.mesh = null;
  }

  // Lines: `points` are pairs of [x, y, z], `colors` one for each pair, `width` in pixels.
  draw(name, points, colors, width = 2) {
    const old = this.lines.get(name);
    old?.object?.removeFromParent();
    old?.object?.geometry.dispose();
    const kept = { points, colors, width, object: null };
    this.lines.set(name, kept);
    if (points.length === 0) { this.ask(); return; }
    const geometry = new LineSegmentsGeometry();
    geometry.setPositions(points.flatMap((point) => point.map((value, at) => value - this.origin[at])));
    geometry.setColors(colors.flatMap((color) => { const { r, g, b } = new Color(color); return [r, g, b, r, g, b]; }));
    this.material ??= new Map();
    if (!this.material.has(width)) this.material.set(width, new LineMaterial({ linewidth: width, vertexColors: true, depthTest: false, depthWrite: false, transparent: true, opacity: 0.9 }));
    kept.object = new LineSegments2(geometry, this.material.get(width));
    kept.object.renderOrder = 2;
    kept.object.frustumCulled = false;
    this.inner.add(kept.object);
    this.ask();
  }

  // Pixel of a point of the map; null behind the camera.
  project(point) {
    const place = new Vector3(...this.toUp(point)).project(this.camera);
    if (place.z > 1 || place.z < -1) return null;
    return [((place.x + 1) / 2) * this.canvas.clientWidth, ((1 - place.y) / 2) * this.canvas.clientHeight];
  }

  // The ray through a pixel, in the map's coordinates.
  ray(x, y) {
    const far = new Vector3((x / this.canvas.clientWidth) * 2 - 1, 1 - (y / this.canvas.clientHeight) * 2, 0.5).unproject(this.camera);
    const direction = far.sub(this.camera.position).normalize();
    return { origin: this.toMap(this.camera.position.toArray()), direction: this.toMap(direction.toArray()) };
  }
}

// Corners of an oriented box, (w, x, y, z), as the 12 pairs of its edges.
export function edges({ center_metres: center, size_metres: size, rotation: [w, x, y, z] }) {
  const pose = new Matrix4().compose(new Vector3(...center), new Quaternion(x, y, z, w), new Vector3(...size));
  const corner = (at) => new Vector3((at & 1) - 0.5, ((at >> 1) & 1) - 0.5, ((at >> 2) & 1) - 0.5).applyMatrix4(pose).toArray();
  const pairs = [];
  for (let at = 0; at < 8; at += 1) for (const bit of [1, 2, 4]) if (!(at & bit)) pairs.push(corner(at), corner(at | bit));
  return pairs;
}
