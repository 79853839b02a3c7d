// Measuring a distance: two points on the splats.
import { element } from './page.js';

const COLOR = '#a3e635';
// Half the length of the cross at a point, metres.
const CROSS = 0.03;

export class Measure {
  // `draw(pairs of points, colors, width)` draws lines; `hit(origin, direction)` is the distance to the splats.
  constructor({ draw, hit }) {
    Object.assign(this, { draw, hit, isOn: false, points: [], tags: [] });
  }

  begin() {
    this.isOn = true;
  }

  end() {
    if (!this.isOn) return;
    Object.assign(this, { isOn: false, points: [], tags: [] });
    this.draw([], []);
  }

  // Adds what a ray hits; after two points begins anew.
  add(origin, direction) {
    const distance = this.hit(origin, direction);
    if (distance === null) return;
    if (this.points.length === 2) this.points = [];
    this.points.push(origin.map((value, at) => value + distance * direction[at]));
    const crosses = this.points.flatMap((point) => [0, 1, 2].flatMap((axis) => [-CROSS, CROSS].map((off) => point.map((value, at) => value + (at === axis ? off : 0)))));
    const pairs = this.points.length === 2 ? [...crosses, ...this.points] : crosses;
    this.draw(pairs, pairs.slice(pairs.length / 2).map(() => COLOR), 2.5);
    this.tags = this.points.length === 2 ? [element('span', `${this.metres().toFixed(2)} m`, 'tag length')] : [];
  }

  metres() {
    const [a, b] = this.points;
    return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
  }

  // Where the length is written; null if there is none.
  middle() {
    const [a, b] = this.points;
    return b ? a.map((value, at) => (value + b[at]) / 2) : null;
  }
}
