// A cloud that is shown by level: which nodes of its octree are drawn, and how they come from the command.
import { Box3, Frustum, Matrix4, Vector3, type PerspectiveCamera } from "three";
import type { Arrays, Levels, Values } from "./data";
import { byId, element } from "./dom";
import { Layer, type Views } from "./scene";

const FINE = 1.2; // pixels between the points of a node; if they are closer, no deeper nodes are drawn
const LEAST = 200_000; // points of a still picture, at least, and
const MOST = 2_000_000; // at most, depending on
const STILL = 400; // how many milliseconds it may take
const HELD = 4_000_000; // points that stay here, drawn or not
const AT_ONCE = 3; // nodes that are asked for
const SAMPLE = 64; // points that tell which share of a node is in view
const UNSEEN = 0.2; // what a point outside the view costs, in points inside

type Place = [x: number, y: number, z: number];

/** A node of the octree. Nodes without points stand for the way to others. */
class Node {
  readonly children: Node[] = [];
  layer: Layer | null = null; // its points, if they are here
  sample: Vector3[] = [];
  request: AbortController | null = null;
  failed = false;
  wanted = 0; // when it was wanted last
  apart = 0; // pixels between its points

  constructor(
    readonly level: number, readonly cell: Place, readonly parent: Node | null, readonly box: Box3,
    readonly number: number, readonly count: number, readonly row: number, readonly start: number,
  ) {
    parent?.children.push(this);
  }

  /** Take a layer with its points. */
  fill(layer: Layer): void {
    this.layer = layer;
    this.box.getCenter(layer.middle).sub(layer.origin).divide(layer.scale);
    this.sample = [...layer.shuffled.subarray(0, SAMPLE)].map((i) => layer.own(i));
  }

  /** Return how many points it costs to draw. */
  cost(frustum: Frustum): number {
    const count = this.layer ? this.layer.cloud.shown : this.count;
    const seen = this.sample.filter((place) => frustum.containsPoint(place)).length / this.sample.length;
    return count * (this.layer ? Math.max(UNSEEN, seen) : 1);
  }

  /** The place among the eight children of the node above. */
  get octant(): number {
    const [x, y, z] = this.cell;
    return (x & 1) + 2 * (y & 1) + 4 * (z & 1);
  }
}

export class Octree {
  chosen: Layer[] = []; // the layers that are drawn beside the first levels
  private readonly nodes: Node[] = []; // those that the page does not hold, from coarse to fine
  private readonly root: Node;
  private readonly picked = new Set<Node>(); // they stay
  private readonly pending = new Set<Node>();
  private readonly told = element("p", "", { id: "levels", className: "drawn" });
  private wanted: Node[] = [];
  private budget = MOST / 2;
  private bound = false; // whether more points are wanted than the budget allows
  private fresh = true; // whether the next picture takes longer, as points are new to the graphics card
  private pause = 0; // milliseconds from the arrival of points to the next picture
  private redraw = 0;
  private time = 0;
  private ended = false; // whether nobody answers any more

  /** Take the nodes of a cloud, whose layer shows the first levels. `paint` gives a new layer its colours. */
  constructor(
    private readonly first: Layer, private readonly levels: Levels, private readonly views: Views,
    private readonly paint: (layer: Layer) => void,
  ) {
    const known = new Map<string, Node>();
    let start = first.cloud.shown;
    for (const [number, [level, x, y, z, count, row]] of levels.nodes.entries()) {
      const node = this.made(known, level, [x, y, z], number, count, row, start);
      if (number < levels.inside) continue;
      this.nodes.push(node);
      start += count;
    }
    this.root = this.made(known, 0, [0, 0, 0]);
    this.root.fill(first);
    byId("views").after(this.told);
  }

  get loaded(): Layer[] {
    return this.nodes.flatMap(({ layer }) => layer ?? []);
  }

  /** Choose what is drawn, coarse nodes first, and ask for what is not here. */
  choose(camera: PerspectiveCamera, turned: Matrix4, pixels: number): void {
    const seen = new Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse).multiply(turned);
    const frustum = new Frustum().setFromProjectionMatrix(seen);
    const eye = camera.position.clone().applyMatrix4(turned.clone().invert());
    const open: Node[] = [];
    const consider = (node: Node) => {
      if (!frustum.intersectsBox(node.box)) return;
      const distance = Math.max(node.box.distanceToPoint(eye), camera.near);
      node.apart = this.levels.spacing / 2 ** node.level / this.first.frame.size * pixels / distance;
      open.push(node);
    };
    this.wanted = [];
    this.bound = false;
    let points = this.root.cost(frustum);
    consider(this.root);
    while (open.length > 0) {
      const next = open.reduce((best, node) => (node.apart > best.apart ? node : best));
      open.splice(open.indexOf(next), 1);
      if (next.number >= this.levels.inside) {
        points += next.cost(frustum);
        this.bound = points > this.budget;
        if (this.bound) break;
        this.wanted.push(next);
      }
      if (next.apart > FINE) next.children.forEach(consider);
    }
    this.time++;
    for (const node of this.wanted) node.wanted = this.time;
    this.chosen = this.wanted.flatMap(({ layer }) => layer ?? []);
    this.fitRadii();
    this.ask();
    this.tell();
  }

  /** Take the milliseconds that a still picture has needed. */
  paced(milliseconds: number): void {
    this.pause = Math.min(milliseconds, 1000);
    const isSlow = milliseconds > 1.3 * STILL;
    if (!this.fresh && (isSlow || (this.bound && milliseconds < STILL / 2))) {
      this.budget *= Math.min(1.25, Math.max(0.5, STILL / milliseconds));
      this.budget = Math.min(MOST, Math.max(LEAST, this.budget));
    }
    this.fresh = false;
  }

  /** Return the layer that holds a point, and its place in that layer's arrays. */
  part(index: number): [Layer, number] {
    const node = this.nodes.findLast(({ start }) => start <= index);
    return node ? [node.layer!, index - node.start] : [this.first, index];
  }

  /** Keep a point here, so that `part` knows it. */
  keep(index: number): void {
    const node = this.nodes.findLast(({ start }) => start <= index);
    if (node) this.picked.add(node);
  }

  private made(known: Map<string, Node>, level: number, cell: Place, number = -1, count = 0, row = 0, start = 0): Node {
    const name = `${level} ${cell}`;
    const found = known.get(name);
    if (found) return found;
    const { low, side } = this.levels;
    const { centre, size } = this.first.frame;
    const corner = (shift: number) => cell.map((part, axis) =>
      (low[axis]! + (part + shift) * side / 2 ** level - centre[axis]!) / size) as Place;
    const box = new Box3(new Vector3(...corner(0)), new Vector3(...corner(1)));
    const above = level > 0 ? this.made(known, level - 1, cell.map((part) => part >> 1) as Place) : null;
    const node = new Node(level, cell, above, box, number, count, row, start);
    known.set(name, node);
    return node;
  }

  /** Draw the points of each node as small as those of the deepest nodes that are drawn around them. */
  private fitRadii(): void {
    for (const layer of [this.first, ...this.chosen]) layer.radii.fill(1);
    for (const { layer, parent, octant } of this.wanted) {
      if (!layer) continue;
      let within = octant;
      for (let above = parent; above; within = above.octant, above = above.parent) {
        const coarse = above.layer;
        if (coarse) coarse.radii[within] = Math.min(coarse.radii[within]!, layer.cloud.spacing / coarse.cloud.spacing);
      }
    }
  }

  /** Ask for the next nodes, and no longer for those that are not wanted any more. */
  private ask(): void {
    for (const node of this.pending) if (!this.wanted.includes(node)) node.request!.abort();
    for (const node of this.wanted) {
      if (this.ended || this.pending.size >= AT_ONCE) return;
      if (!node.layer && !node.request && !node.failed) void this.load(node);
    }
  }

  private async load(node: Node): Promise<void> {
    const request = node.request = new AbortController();
    this.pending.add(node);
    try {
      const answer = await fetch(String(node.number), { signal: request.signal });
      if (answer.ok) this.add(node, await answer.arrayBuffer());
      else node.failed = true;
    } catch (error) {
      if (!request.signal.aborted) this.ended = true;
    }
    this.pending.delete(node);
    node.request = null;
    this.ask();
    this.tell();
  }

  private add(node: Node, content: ArrayBuffer): void {
    const { first, levels, views } = this;
    const { low, spacing, arrays, numbers } = readNode(content, node, first, levels);
    const cloud = { ...first.cloud, shown: node.count, low, step: levels.scales, spacing };
    const layer = new Layer(cloud, arrays, first.frame);
    layer.start = node.start;
    layer.numbers = numbers;
    layer.share(first);
    node.fill(layer);
    this.paint(layer);
    views.add(layer.points);
    this.fresh = true;
    this.drop();
    this.redraw ||= window.setTimeout(() => {
      this.redraw = 0;
      views.draw();
    }, this.pause);
  }

  /** Drop the nodes that were not wanted for the longest time, if too many points are here. */
  private drop(): void {
    const here = this.nodes.filter(({ layer }) => layer).sort((a, b) => a.wanted - b.wanted);
    let points = here.reduce((sum, { count }) => sum + count, 0);
    for (const node of here) {
      if (points <= HELD) return;
      if (this.wanted.includes(node) || this.picked.has(node)) continue;
      this.views.remove(node.layer!.points);
      [node.layer, node.sample] = [null, []];
      points -= node.count;
    }
  }

  /** Tell what is drawn, and what is on its way. */
  private tell(): void {
    const drawn = this.chosen.reduce((sum, { cloud }) => sum + cloud.shown, this.first.cloud.shown);
    const missing = this.wanted.filter(({ layer, failed }) => !layer && !failed).length;
    const failed = this.nodes.filter((node) => node.failed).length;
    const words = [`${drawn.toLocaleString("en")} of ${this.first.cloud.points.toLocaleString("en")} points are drawn`];
    if (missing) words.push(this.ended ? "no more can come: gppcs view has ended" : `parts on their way: ${missing}`);
    if (failed) words.push(`parts that cannot be read: ${failed}`);
    const text = `${words.join("; ")}.`;
    if (text !== this.told.textContent) this.told.textContent = text; // a new one is laid out, which takes time
  }
}

/** Read the points of a node, as Levels.node in drawing/web/levels.py writes them. */
function readNode(content: ArrayBuffer, { count: n, row }: Node, { cloud }: Layer, { scales, offsets }: Levels) {
  let place = 0;
  type Kind<A> = new (content: ArrayBuffer, from: number, count: number) => A;
  const next = <A extends ArrayBufferView>(kind: Kind<A>, count: number): A => {
    const array = new kind(content, place, count);
    place += array.byteLength;
    return array;
  };
  const [x, y, z, spacing] = next(Float64Array, 4) as unknown as [number, number, number, number];
  const positions = Float32Array.from(next(Uint32Array, 3 * n));
  const numbers = new Map<Values, Uint16Array>(cloud.values.map((values) => [values, next(Uint16Array, n)]));
  const arrays: Arrays = {
    positions,
    normals: next(Uint8Array, 2 * n),
    spreads: next(Uint8Array, n),
    rows: Uint32Array.from({ length: n }, (_, i) => row + i),
    colours: cloud.blocks.colours ? next(Uint8Array, 3 * n) : null,
    originals: null,
  };
  const low = [x, y, z].map((whole, axis) => whole * scales[axis]! + offsets[axis]!) as Place;
  return { low, spacing, arrays, numbers };
}
